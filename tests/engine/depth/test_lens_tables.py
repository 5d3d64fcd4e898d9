"""A lens in tables: directions, illumination, and rays that shape out-of-focus light."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import fine_grid_lens, tinted
from lensfield.engine import load_lens
from lensfield.engine.field.field_map import field_map
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.iris import Iris, opening
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.look.lens_tables import BOKEH_NODES, COLOURS_NM, NODES, lens_tables
from lensfield.engine.rays.rings import Rings

MIDDLE = BOKEH_NODES // 2
NEAR = Rings(2000.0)


def tables_of(name, rings=NEAR, iris=None, **options):
    """A lens, a frame of 1080 rows, and its tables."""
    lens = load_lens(name, rings, "preview", wavelengths_nm=COLOURS_NM)
    width_mm, height_mm = lens.sensor_mm
    frame = PixelGrid((1080, round(1080 * width_mm / height_mm)), height_mm / 1080 * 1e3)
    return lens, frame, lens_tables(lens, lens_rays(lens, opening(iris, lens).reach), frame, iris, **options)


def between(table, row, column):
    """Bilinear interpolation of a table, as shaders do it."""
    i, j = int(row), int(column)
    u, v = row - i, column - j
    return ((1 - u) * ((1 - v) * table[i, j] + v * table[i, j + 1])
            + u * ((1 - v) * table[i + 1, j] + v * table[i + 1, j + 1]))


@pytest.mark.sample(4)
@pytest.mark.parametrize("name", ["edmund-54852", "tessar-50mm", "zeiss-hologon-15mm", "nikkor-58mm-f1.4",
                                  "kodak-petzval-100mm", "olympus-fisheye-8mm", "canon-fd-500mm-f4.5"])
def test_light_comes_from_where_the_engine_sees_it(name):
    lens, frame, tables = tables_of(name)
    (rows, columns), pitch_mm = frame.shape_px, frame.pitch_um * 1e-3
    for right, up in ((0.137, 0.861), (0.943, 0.309), (0.518, 0.492), (0.993, 0.988)):
        x_mm, y_mm = (right - 0.5) * columns * pitch_mm, (up - 0.5) * rows * pitch_mm
        angles_rad = between(tables.angle_rad, up * (NODES - 1), right * (NODES - 1))
        for angle_rad, nm in zip(angles_rad, COLOURS_NM, strict=True):
            field = field_map(lens).at_wavelength(nm)
            angle = np.hypot(*angle_rad)
            seen_mm = angle_rad * np.tan(angle) / angle * lens.capture_focal_length_mm
            landing_mm = field.landing_mm(*seen_mm)
            off_px = np.hypot(*(landing_mm - np.array([x_mm, y_mm]))) / pitch_mm
            assert off_px < 0.15 or lens.dark_beyond and not field.relative_illumination(x_mm, y_mm), (
                "half of the live view's limit")
        light = between(tables.illumination, up * (NODES - 1), right * (NODES - 1))
        green = field_map(lens).at_wavelength(COLOURS_NM[1])
        assert light == pytest.approx(green.relative_illumination(x_mm, y_mm), abs=0.01)


def test_discs_have_the_size_of_the_first_order_blur_on_the_axis():
    _, _, tables = tables_of("tessar-50mm", Rings(2000.0, 8.0))
    shift, light = tables.shifts[MIDDLE, MIDDLE], tables.light[MIDDLE, MIDDLE]
    assert light.sum() == pytest.approx(1, abs=1e-5)
    assert np.sqrt((light[:, None] * shift**2).sum()) == pytest.approx(np.sqrt(0.5), rel=0.03), "a uniform disc's"
    assert np.hypot(*tables.aberrations[MIDDLE, MIDDLE].T).max() < 1e-3


def test_cats_eyes_lean_towards_the_middle_of_the_picture():
    _, _, tables = tables_of("kodak-petzval-100mm")
    for row, column in ((1, BOKEH_NODES - 2), (BOKEH_NODES - 3, 2)):
        outwards = np.array([column - MIDDLE, row - MIDDLE]) / np.hypot(column - MIDDLE, row - MIDDLE)
        across = np.array([-outwards[1], outwards[0]])
        shift, light = tables.shifts[row, column], tables.light[row, column]
        width, height = (np.sqrt((light * (shift @ along)**2).sum() - (light @ (shift @ along))**2)
                         for along in (across, outwards))
        assert height < 0.9 * width


def test_a_flipped_picture_has_flipped_rays():
    _, _, tables = tables_of("nikkor-58mm-f1.4")
    row, column = 2, 13
    moved, flipped = ((tables.light[at, column][:, None] * tables.shifts[at, column] ** 3).sum(axis=0)
                      for at in (row, BOKEH_NODES - 1 - row))
    assert flipped == pytest.approx(moved * (1, -1), abs=0.02)


def test_blades_cut_the_disc():
    iris = Iris(4, 0.0)  # a square, with sides to the right and up
    _, _, tables = tables_of("tessar-50mm", Rings(2000.0, 16.0), iris)
    shift, light = tables.shifts[MIDDLE, MIDDLE], tables.light[MIDDLE, MIDDLE]
    half = np.sqrt(np.pi) / 2  # the side of a square of the round stop's area
    assert np.sqrt((light[:, None] * shift**2).sum(axis=0)) == pytest.approx([half / np.sqrt(3)] * 2, rel=0.04)
    turned = shift @ np.array([[1, 1], [-1, 1]]) / np.sqrt(2)
    fourth = [(light[:, None] * each**4).sum(axis=0) for each in (shift, turned)]
    assert np.all(fourth[1] > 1.2 * fourth[0]), "corners reach farther than sides"


def test_the_area_beyond_the_lens_data_is_black_on_request():
    lens = load_lens("tessar-50mm", Rings(), "preview", wavelengths_nm=COLOURS_NM)
    frame = PixelGrid((40, 60), 1500.0)  # larger than the picture circle
    rays = lens_rays(lens)
    held, black = (lens_tables(lens, rays, frame, vignette=vignette).illumination for vignette in (False, True))
    assert held.min() > 0.1
    assert black[0, 0] == 0 and black[NODES // 2, NODES // 2] == pytest.approx(1, abs=1e-3)


def test_the_area_beyond_the_lens_data_has_the_rays_of_its_edge():
    """In the corners of a sensor that is twice as large, rays still surround the chief ray."""
    lens = load_lens("kodak-petzval-100mm", NEAR, "preview", wavelengths_nm=COLOURS_NM)
    frame = PixelGrid((480, 720), 2 * lens.sensor_mm[0] / 720 * 1e3)
    tables = lens_tables(lens, lens_rays(lens, 1.0), frame)
    pixel = frame.pitch_um * 1e-3 / lens.capture_focal_length_mm
    mean = (tables.aberrations * tables.light[..., None]).sum(axis=2) / pixel
    assert np.abs(mean).max() < 0.5
    corner, edge = (tables.shifts[row, column] for row, column in ((-1, -1), (-4, -4)))
    np.testing.assert_allclose(corner, edge, atol=1e-6)


def test_a_glass_that_absorbs_does_not_darken_the_view():
    lens = load_lens("tessar-50mm", Rings(), "preview", wavelengths_nm=COLOURS_NM)
    frame = PixelGrid((40, 60), 400.0)
    clear, dark = (lens_tables(each, lens_rays(lens), frame) for each in (lens, tinted(lens)))
    assert np.array_equal(clear.illumination, dark.illumination)
    assert np.array_equal(clear.light, dark.light)


def test_a_lens_without_prescription_has_round_discs():
    lens = replace(load_lens("edmund-54852", Rings(), "preview", wavelengths_nm=COLOURS_NM), prescription=None)
    frame = PixelGrid((576, 768), 6.25)
    tables = lens_tables(lens, lens_rays(lens), frame)
    size = np.sqrt((tables.light[..., None] * tables.shifts**2).sum(axis=2))
    assert size == pytest.approx(np.full_like(size, 0.5), rel=0.05)


def test_the_discs_of_a_squeezed_lens_are_half_as_wide_as_high_around_its_light():
    """Through a lens with barrel distortion across, a prism up and a plane of focus that leans; without aberrations."""
    lens = fine_grid_lens(source_mm=lambda nm, x, y: (x * (1 + 0.02 * x**2), y + 0.05 * y**2), squeeze=2.0,
                          focus_slope=(1e-3, 0.0), wavelengths_nm=(400.0, 550.0, 700.0))
    tables = lens_tables(lens, lens_rays(lens), PixelGrid((360, 480), 10.0))
    for row, column in ((MIDDLE, MIDDLE), (3, 14)):
        shift, light = tables.shifts[row, column], tables.light[row, column]
        assert np.sqrt((light[:, None] * shift**2).sum(axis=0)) == pytest.approx([0.25, 0.5], rel=0.03)
        assert np.abs(tables.aberrations[row, column]).max() < 1e-4
