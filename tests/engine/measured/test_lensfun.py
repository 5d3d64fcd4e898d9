"""Lensfun distorts, shifts colours and darkens as the lens that is read from its database.

Without lensfunpy, these tests are skipped: make test-calibration runs them.
"""

from pathlib import Path

import numpy as np
import pytest

from lensfield.engine.field.field_map import field_map
from lensfield.engine.measured.files import lens_of, read_measured
from lensfield.engine.measured.lensfun import installed_database
from lensfield.engine.measured.options import MeasuredOptions

lensfunpy = pytest.importorskip("lensfunpy", reason="lensfunpy is not installed: make test-calibration")
COLUMNS_PX = 2400
FOUR_THIRDS = "Olympus 9mm Body Cap Lens Fisheye",
SINGLE_PX, LIGHT = 0.02, 2e-4  # Lensfun computes in single precision; light is fitted by polynomials
MOST_DEG = 78.0
LENSES = [  # a lens, its focal length, f-number and distance in m
    ("Canon EF-S 10-22mm f/3.5-4.5 USM", 10.0, 8.0, 10.0),
    ("Canon EF-S 10-22mm f/3.5-4.5 USM", 11.0, 4.2, 30.0),
    ("Canon EF-S 10-22mm f/3.5-4.5 USM", 17.5, 6.3, 1000.0),
    ("Samyang 14mm f/2.8 AE ED AS IF UMC", 14.0, 4.0, 1000.0),
    ("Canon EF 8-15mm f/4L Fisheye USM", 15.0, 5.6, 1000.0),
    ("Olympus 9mm Body Cap Lens Fisheye", 9.0, 8.0, 1000.0), ("Sigma 10mm f/2.8 EX DC Fisheye HSM", 10.0, 8.0, 2.0),
    ("Carl Zeiss Distagon T* 2,8/21 ZE", 21.0, 5.6, 1000.0)]


@pytest.fixture(scope="module")
def folder():
    return Path(lensfunpy.__file__).parent / "db_files"


@pytest.fixture(scope="module")
def database():
    return lensfunpy.Database(load_common=False)


def of_lensfun(database, name):
    """The lens in the database that was measured on the largest sensor."""
    return min((lens for lens in database.lenses if lens.model == name), key=lambda lens: lens.crop_factor)


def size_of(lens):
    """Columns and rows of a picture with the aspect ratio of the lens's sensor."""
    return COLUMNS_PX, round(COLUMNS_PX / (4 / 3 if lens.model in FOUR_THIRDS else 3 / 2))


def modifier_of(lens, focal_mm, f_number, distance_m, **options):
    modifier = lensfunpy.Modifier(lens, lens.crop_factor, *size_of(lens))
    modifier.initialize(focal_mm, f_number, distance_m, scale=1.0, pixel_format=np.float32, **options)
    return modifier


def read(folder, known, focal_mm, f_number, distance_m):
    options = MeasuredOptions(known.model, size_of(known), focal_mm, None, f_number, distance_m * 1e3)
    measured = read_measured(folder, options)
    return measured, lens_of(measured, options)


def places_px(size_px, number=41):
    """Columns and rows of whole pixels, over the picture."""
    return np.stack(np.meshgrid(*(np.linspace(0, side - 1, number).round().astype(int) for side in size_px)),
                    axis=-1).reshape(-1, 2)


def size_on_axis(known, focal_mm):
    """Of the lens's picture, relative to the undistorted one."""
    distortion = known.interpolate_distortion(focal_mm)
    unchanged = distortion is None or distortion.model == lensfunpy.DistortionModel.POLY5
    return 1.0 if unchanged else 1 - sum(distortion.terms)


@pytest.mark.parametrize("name, focal_mm, f_number, distance_m", LENSES)
def test_lensfun_distorts_as_the_lens(folder, database, name, focal_mm, f_number, distance_m):
    """Undistorted pixels, as a plane shows them, are where Lensfun has them in the lens's picture."""
    known = of_lensfun(database, name)
    (measured, lens), size_px = read(folder, known, focal_mm, f_number, distance_m), np.array(size_of(known))
    modifier = modifier_of(known, focal_mm, f_number, distance_m, targeom=lensfunpy.LensType.RECTILINEAR,
                           flags=lensfunpy.ModifyFlags.DISTORTION | lensfunpy.ModifyFlags.GEOMETRY)
    pixels = places_px(size_px)
    expected = np.array([modifier.apply_geometry_distortion(x, y, 1, 1)[0, 0] for x, y in pixels])
    straight_px = measured.focal_px[0] / size_on_axis(known, focal_mm)
    off_axis = (pixels - (size_px - 1) / 2) / straight_px
    pitch_mm = lens.sensor_mm[0] / size_px[0]
    focal_mm = lens.capture_focal_length_mm
    landed = field_map(lens).at_wavelength(540).landing_mm(*(focal_mm * off_axis * (1, -1)).T)
    landed_px = (np.stack(landed, axis=1) / pitch_mm) * (1, -1) + (size_px - 1) / 2
    inside = np.all(np.abs(expected / size_px - 0.5) < 0.5, axis=1)
    inside &= np.hypot(*off_axis.T) < np.tan(np.radians(MOST_DEG))
    assert inside.sum() > 500
    assert np.abs(landed_px - expected)[inside].max() < SINGLE_PX


@pytest.mark.parametrize("name, focal_mm, f_number, distance_m", LENSES)
def test_lensfun_shifts_colours_as_the_lens(folder, database, name, focal_mm, f_number, distance_m):
    known = of_lensfun(database, name)
    if not known.calib_tca:
        pytest.skip("no lateral colour")
    (_, lens), size_px = read(folder, known, focal_mm, f_number, distance_m), np.array(size_of(known))
    modifier = modifier_of(known, focal_mm, f_number, distance_m, flags=lensfunpy.ModifyFlags.TCA)
    middle_px, pitch_mm = (size_px - 1) / 2, lens.sensor_mm[0] / size_px[0]
    maps = {nm: field_map(lens).at_wavelength(nm) for nm in (465, 540, 610)}
    for column in np.linspace(middle_px[0] + 100, size_px[0] - 1, 9).round().astype(int):
        row = round(middle_px[1] + (column - middle_px[0]) * middle_px[1] / middle_px[0])
        shifted = modifier.apply_subpixel_distortion(column, row, 1, 1)[0, 0]  # of red, green and blue
        light = maps[540].source_mm(*((np.array([column, row]) - middle_px) * (1, -1) * pitch_mm)[:, None])
        for channel, nm in enumerate((610, 540, 465)):
            landed_px = np.ravel(maps[nm].landing_mm(*light)) * (1, -1) / pitch_mm + middle_px
            assert np.abs(landed_px - shifted[channel]).max() < SINGLE_PX


@pytest.mark.parametrize("name, focal_mm, f_number, distance_m", LENSES)
def test_lensfun_darkens_as_the_lens(folder, database, name, focal_mm, f_number, distance_m):
    known = of_lensfun(database, name)
    (measured, lens), size_px = read(folder, known, focal_mm, f_number, distance_m), np.array(size_of(known))
    if not known.calib_vignetting:
        assert "has no vignetting" in lens.notes
        return
    modifier = modifier_of(known, focal_mm, f_number, distance_m, flags=lensfunpy.ModifyFlags.VIGNETTING)
    picture = np.ones((size_px[1], size_px[0], 3), np.float32)
    modifier.apply_color_modification(picture)
    pixels = places_px(size_px)[::7]
    expected = 1 / picture[pixels[:, 1], pixels[:, 0], 1]
    half_px = np.hypot(*size_px) / 2
    shares = np.hypot(*(pixels - (size_px - 1) / 2).T) / half_px
    np.testing.assert_allclose(measured.light(shares), expected, atol=LIGHT)
    at_mm, real_mm = shares * half_px * lens.sensor_mm[0] / size_px[0], lens.real_height_mm[4]
    light = np.interp(at_mm, real_mm, lens.relative_illumination[4])
    np.testing.assert_allclose(light[at_mm < real_mm[-1]], expected[at_mm < real_mm[-1]], atol=2e-3)


def test_an_installed_database_is_read_by_default():
    assert any(installed_database().glob("*.xml"))
