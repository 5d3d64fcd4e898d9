"""The rays of a lens: from its prescription, or from its first-order data."""

from dataclasses import fields
from io import BytesIO

import numpy as np
import pytest

from forged import forge
from lenses import make_lens
from lensfield.engine import Options, SpectralImage, simulate
from lensfield.engine.field.radial.distortion import FieldGeometry
from lensfield.engine.field.radial.first_order import first_order_rays
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.entrance_pupil import entrance_pupil_diameter_mm, focus_nearness
from lensfield.engine.lens_files.package import read_package, write_package
from lensfield.engine.library import Rings, load_lens
from lensfield.engine.library import rays as library_rays
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.rays.ray_table import ray_table
from varied_lenses import VARIED, varied_lens


def some_rays(table, nm, height_mm, count=64):
    rng = np.random.default_rng(1)
    radius, azimuth = np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    stop = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)])
    place_mm = np.broadcast_to([[-0.6 * height_mm], [0.8 * height_mm]], stop.shape)
    return table.at([nm]).rays(0, place_mm, stop), place_mm, stop


@pytest.mark.parametrize("share", [0.0, 0.5, 0.95])
@pytest.mark.parametrize("distance_mm", [np.inf, 700.0])
def test_first_order_rays_meet_in_the_plane_of_focus_at_the_imaged_point(distance_mm, share):
    lens = make_lens(real_height_mm=lambda nm, p: p * (1 - 0.02 * p), object_distance_mm=distance_mm,
                     magnification=0.0 if np.isinf(distance_mm) else -0.1)
    table, nm = first_order_rays(lens), float(lens.wavelengths_nm[0])
    rays, place_mm, stop = some_rays(table, nm, share * table.last_height_mm)
    ideal_mm = lens.capture_focal_length_mm * (focus_nearness(lens) * rays.entrance_mm
                                               - rays.direction[:2] / rays.direction[2])
    field = FieldGeometry(lens.at_wavelength(nm), lens.name)
    real_mm = np.hypot(*place_mm)
    expected = -place_mm * field.paraxial_per_real(real_mm, field.paraxial_height_mm(real_mm))
    assert np.allclose(ideal_mm, expected, atol=1e-5 * table.last_height_mm)
    assert np.allclose(rays.entrance_mm, stop * entrance_pupil_diameter_mm(lens) / 2, rtol=1e-4, atol=1e-4)
    assert np.allclose(rays.margin, 1 - np.sum(stop**2, axis=0))


@pytest.mark.parametrize("distance_mm", [np.inf, 700.0])
def test_first_order_rays_from_the_point_in_focus_have_equal_paths(distance_mm):
    lens = make_lens(real_height_mm=lambda nm, p: p * (1 - 0.02 * p), object_distance_mm=distance_mm,
                     magnification=0.0 if np.isinf(distance_mm) else -0.1)
    table = first_order_rays(lens)
    rays, _, _ = some_rays(table, float(lens.wavelengths_nm[0]), 0.7 * table.last_height_mm)
    nearness = focus_nearness(lens)
    tangent = rays.direction[:2] / rays.direction[2]
    if nearness:
        to_plane_mm = 1 / nearness / rays.direction[2]
    else:  # from a plane across the bundle, through the middle of the pupil
        to_plane_mm = np.sum(rays.entrance_mm * rays.direction[:2], axis=0)
    way_mm = to_plane_mm + rays.path_mm
    assert np.ptp(way_mm) < 2e-5 * np.abs(way_mm).max() + 1e-5 and np.isfinite(tangent).all()


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", VARIED[:3])
def test_a_lens_traces_its_rays_from_its_prescription(name):
    lens = varied_lens(name)
    table, nm = lens_rays(lens), lens.reference_wavelength_nm
    assert table == ray_table(lens.prescription) and lens_rays(lens) is table
    traced, *_ = some_rays(table, nm, 0.2 * table.last_height_mm)
    first_order, *_ = some_rays(first_order_rays(lens), nm, 0.2 * table.last_height_mm)
    pupil_mm = entrance_pupil_diameter_mm(lens)
    assert np.abs(traced.entrance_mm - first_order.entrance_mm).max() < 0.1 * pupil_mm
    assert np.allclose(traced.weight, first_order.weight, rtol=0.5)


def test_rays_are_cached_and_scale_with_the_lens(monkeypatch, tmp_path):
    monkeypatch.setenv("LENSFIELD_CACHE", str(tmp_path))
    lens = varied_lens(VARIED[0])
    lens_rays.cache_clear()
    first = lens_rays(lens)
    lens_rays.cache_clear()
    monkeypatch.setattr(library_rays, "ray_table", lambda *_: pytest.fail("traced twice"))
    assert lens_rays(lens) == first
    monkeypatch.undo()
    large = lens_rays(lens.scaled(2))
    one, *_ = some_rays(large, 550.0, 2 * 0.8 * first.last_height_mm)
    other, *_ = some_rays(first, 550.0, 0.8 * first.last_height_mm)
    assert np.allclose(one.entrance_mm, 2 * other.entrance_mm, atol=1e-4)
    assert np.allclose(one.direction, other.direction, atol=1e-5)
    assert np.allclose(one.weight, other.weight, rtol=1e-4)
    assert np.allclose(one.path_mm, 2 * other.path_mm, atol=1e-4)


@pytest.mark.parametrize("factor", [0.06, 2.0])
def test_rays_of_a_scaled_lens_end_where_its_lens_data_do(factor):
    """Wherever the light of its data is held beyond their end, in focus, so is the light of its rays."""
    lens = load_lens("kodak-petzval-100mm", quality="preview")
    scaled = lens.scaled(factor)
    rays, expected = lens_rays(scaled), lens_rays(lens)
    assert rays.last_height_mm == pytest.approx(factor * expected.last_height_mm, rel=1e-6)
    assert not (rays.dark_beyond or expected.dark_beyond or scaled.dark_beyond)


def archive(table, **changes):
    """A table as it is cached, with changed arrays."""
    stream = BytesIO()
    names = [field.name for field in fields(table) if field.name != "name"]
    np.savez(stream, **{name: getattr(table, name) for name in names} | changes)
    return stream.getvalue()


def test_forged_rays_are_traced_again(monkeypatch, tmp_path):
    monkeypatch.setenv("LENSFIELD_CACHE", str(tmp_path))
    lens = varied_lens(VARIED[0])
    lens_rays.cache_clear()
    first = lens_rays(lens)
    coefficients = first.coefficients
    for content in (b"junk", archive(first)[:-30], archive(first, wavelengths_nm=np.array([550.0])),
                    archive(first, coefficients=coefficients[..., :3]), archive(first, coefficients=coefficients[0]),
                    archive(first, coefficients=coefficients.astype(float)), archive(first, reach=np.array(["wide"]))):
        forge(tmp_path, "rays", content)
        lens_rays.cache_clear()
        assert lens_rays(lens) == first
    lens_rays.cache_clear()


def test_a_package_has_no_prescription_unless_it_is_a_bundled_one(tmp_path):
    lens = load_lens("edmund-54852")
    assert lens.prescription is not None
    write_package(lens, tmp_path / "mine.npz")
    assert read_package(tmp_path / "mine.npz").prescription is None


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["sonnar-50mm-f1.5", "nikkor-28mm"])
def test_even_radiance_is_as_bright_by_psfs_as_by_rays(name):
    """Although they are independent: the only loss is the light outside a PSF's window, half a hundredth.

    At wide apertures a PSF's coma moves a twentieth of the light; and colours differ by some hundredths.
    """
    lens, nm = load_lens(name, Rings(2000.0), "preview"), [430.0, 550.0, 670.0]
    pitch_um = lens.sensor_mm[0] / 96 * 1e3
    grid = PixelGrid.around_frame((2, 96), pitch_um, (24, 24))
    even = SpectralImage(np.ones((3, *grid.shape_px), np.float32), nm, grid, focal_mm=lens.capture_focal_length_mm)
    image, sensor = simulate(even, lens, Options(accuracy=0.003)), grid.frame()
    heights_mm = np.abs(sensor.axes_mm()[0])
    by_rays = lens_rays(lens).at(nm).irradiance_per_radiance(heights_mm)
    by_rays *= np.array([lens.at_wavelength(each).transmittance for each in nm])[:, None]
    off = image.cube.mean(axis=1) / by_rays - 1
    inner = (heights_mm > 3e-3 * pitch_um) & (heights_mm < 0.9 * heights_mm.max())  # on the axis itself PSFs rotate
    assert np.sqrt(np.mean(off[:, inner]**2)) < 0.015
