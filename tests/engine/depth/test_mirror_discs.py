"""Out-of-focus discs of a mirror lens, with the hole of its central obstruction, by rays in plain vectors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import qmc

from lensfield.engine import Options, Rings, load_lens, simulate
from lensfield.engine.depth.depth_range import blur_per_nearness_px
from lensfield.engine.field.radial.first_order import first_order_rays
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.entrance_pupil import focus_nearness
from lensfield.engine.library.rays import lens_rays
from lensfield.engine.look.lens_curves import lens_curves
from lensfield.engine.look.lens_tables import lens_tables
from lensfield.engine.prescription.readers.toml import write_prescription
from lensfield.engine.rays.focus import build_system
from mirror_lens import MIRROR_LENS
from physical_rays import trace

NM, FOCUS_MM, RADIANCE, DISC_PX = 550.0, 4000.0, 7.0, 60
FRAME_PX, MARGIN_PX = (95, 113), (40, 36)
RAYS = 2**18
LAMP_PX, COARSE_PX = 3, 5  # sides of the lamp, and of the blocks that are compared


@pytest.fixture(scope="module")
def lens(tmp_path_factory):
    path = tmp_path_factory.mktemp("mirror") / "mirror-lens.toml"
    path.write_text(write_prescription(MIRROR_LENS))
    return load_lens(path, Rings(FOCUS_MM), quality="preview", wavelengths_nm=[NM])


def in_colour(lens):
    """The lens with the same tables at two wavelengths, around all colours."""
    twice = {name: np.repeat(getattr(lens, name), 2, axis=0) for name in
             ("relative_illumination", "psf", "enclosed_energy", "transmittance", "point_flux", "real_height_mm")}
    return replace(lens, wavelengths_nm=[400.0, 700.0], **twice)


def landed_mm(lens, tangent, side, depth_mm):
    """Where rays from a square right of and above the axis, with this side as a tangent, land in the upright picture,
    and their light for a radiance of 1."""
    system = build_system(lens.prescription)
    radius, turn, *within = qmc.Sobol(4, seed=3).random(RAYS).T
    points = depth_mm * (np.reshape(tangent, (2, 1)) + side * (np.array(within) - 0.5))
    aim_mm = 1.5 * abs(system.marginal_heights_mm[0])
    aim = aim_mm * np.sqrt(radius) * np.array([np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)])
    way = np.stack([*(aim - points), np.full(RAYS, depth_mm)])
    direction = way / np.linalg.norm(way, axis=0)
    start = np.stack([*aim, np.zeros(RAYS)]) - direction / direction[2] * (system.entrance_pupil_mm + 30.0)
    start[2] += system.entrance_pupil_mm
    indices = np.abs(system.indices_at([NM])[:, 0])
    position, _, _, is_open, stop_mm = trace(system.prescription, indices, start, direction)
    is_open &= np.hypot(*stop_mm) <= system.stop_semi_aperture_mm
    light = direction[2]**4 * side**2 * np.pi * aim_mm**2 / RAYS
    return -position[:2, is_open], light[is_open]


def scene(lens, tangent, depth_mm):
    """A square lamp out of focus: its capture, and its light as rays see it."""
    pitch_um = 1e3 * blur_per_nearness_px(lens, 1e3) * abs(1 / depth_mm - focus_nearness(lens)) / DISC_PX
    rows, columns = np.add(FRAME_PX, np.multiply(MARGIN_PX, 2))
    up, right = np.round(np.array(tangent)[::-1] * lens.capture_focal_length_mm / pitch_um * 1e3)
    grid = PixelGrid((rows, columns), pitch_um, (rows // 2 + up + 6, columns // 2 - right - 9), MARGIN_PX)
    lit, half = np.zeros(grid.shape_px), LAMP_PX // 2
    lit[rows // 2 + 6 - half:rows // 2 + 7 + half, columns // 2 - 9 - half:columns // 2 - 8 + half] = 1
    layer = Layer(RADIANCE * lit[None], np.ones(lit.shape), np.full(lit.shape, depth_mm))
    pixel = pitch_um * 1e-3 / lens.capture_focal_length_mm
    points_mm, light = landed_mm(lens, pixel * np.array([right, up]), LAMP_PX * pixel, depth_mm)
    return LayeredRadiance((layer,), [NM], grid), points_mm, light * RADIANCE


def picture_of(grid, points_mm, light):
    """Points binned to the pixels of a grid's frame, in W m^-2 nm^-1."""
    x_mm, y_mm = grid.axes_mm()
    half = grid.pitch_um * 5e-4
    edges = [np.append(each - half, each[-1] + half) for each in (np.sort(y_mm), x_mm)]
    counts, *_ = np.histogram2d(points_mm[1], points_mm[0], edges, weights=light)
    return counts[::-1] / (grid.pitch_um * 1e-3) ** 2


def coarse(picture):
    rows, columns = (n // COARSE_PX * COARSE_PX for n in picture.shape)
    picture = picture[:rows, :columns]
    return picture.reshape(rows // COARSE_PX, COARSE_PX, -1, COARSE_PX).mean(axis=(1, 3))


def hole_and_rim(grid, picture, middle_mm):
    """Radii of a ring's inner and outer edge in pixels: where the light is half of that between them."""
    x_mm, y_mm = np.meshgrid(*grid.axes_mm())
    radius_px = np.hypot(x_mm - middle_mm[0], y_mm - middle_mm[1]) / (grid.pitch_um * 1e-3)
    bins = np.arange(0, 0.62 * DISC_PX, 1.0)
    light, _ = np.histogram(radius_px, bins, weights=picture)
    count, _ = np.histogram(radius_px, bins)
    profile, middles = light / np.maximum(count, 1), (bins[1:] + bins[:-1]) / 2
    level = np.median(profile[(middles > 0.36 * DISC_PX) & (middles < 0.44 * DISC_PX)]) / 2
    inner = np.interp(level, np.maximum.accumulate(profile[:int(0.36 * DISC_PX)]), middles[:int(0.36 * DISC_PX)])
    outer = np.interp(-level, -profile[int(0.44 * DISC_PX):], middles[int(0.44 * DISC_PX):])
    return inner, outer


def shown_and_traced(lens, tangent, depth_mm):
    """The picture of a lamp through a dimmed lens, the same by rays, and the middle of the disc in mm."""
    layered, points_mm, light = scene(lens, tangent, depth_mm)
    lens = replace(lens, transmittance=np.full_like(lens.transmittance, 0.83))
    shown = simulate(layered, lens, Options(accuracy=0.001))
    true = 0.83 * picture_of(shown.grid, points_mm, light)
    return shown.grid, shown.cube[0], true, np.average(points_mm, axis=1, weights=light)


def test_the_hole_and_the_rim_of_a_disc_on_the_axis(lens):
    grid, ours, true, middle_mm = shown_and_traced(lens, (0.0, 0.0), 1500.0)
    assert ours.sum() == pytest.approx(true.sum(), rel=0.005)
    radii, true_radii = (hole_and_rim(grid, each, middle_mm) for each in (ours, true))
    np.testing.assert_allclose(radii, true_radii, rtol=0, atol=0.2)
    assert radii[0] / radii[1] == pytest.approx(lens.central_obstruction, rel=0.05)


@pytest.mark.parametrize("depth_mm", [1500.0, 30000.0])
def test_light_in_discs_off_the_axis(lens, depth_mm):
    """Where rims vignette, and the hole is off the middle."""
    _, ours, true, _ = shown_and_traced(lens, (0.021, 0.026), depth_mm)
    assert ours.sum() == pytest.approx(true.sum(), rel=0.01)
    assert np.abs(coarse(ours) - coarse(true)).sum() < 0.06 * coarse(true).sum()


def test_rays_carry_the_light_of_the_f_number(lens):
    """Traced ones, up to aberrations, and ones to first order from tables alone, which have the hole on the axis."""
    light, axis = np.pi / (4 * lens.f_number_effective**2), np.zeros(1)
    np.testing.assert_allclose(lens_rays(lens).near([NM]).irradiance_per_radiance(axis)[0], light, rtol=0.01)
    first_order = first_order_rays(replace(lens, prescription=None))
    np.testing.assert_allclose(first_order.irradiance_per_radiance(axis)[0], light, rtol=0.006)
    stop = np.array([[0.0, 0.0, 0.0], [0.0, 0.5, 0.7]])
    np.testing.assert_array_equal(first_order.rays(0, np.zeros((2, 1)), stop).margin > 0, [False, False, True])


def test_live_and_quick_look_show_the_hole(lens):
    frame = PixelGrid((60, 90), 80.0)
    tables = lens_tables(in_colour(lens), lens_rays(lens), frame)
    on_axis = tables.light[8, 8]
    dark = tables.stop_radius < 0.8 * lens.central_obstruction
    assert dark.any() and not on_axis[dark].any() and on_axis[tables.stop_radius > 0.7].all()
    bokeh = lens_curves(in_colour(lens), 7.0).bokeh
    round_stop = lens_curves(in_colour(replace(lens, central_obstruction=0.0)), 7.0).bokeh
    assert bokeh.sum() / round_stop.sum() == pytest.approx(1 - lens.central_obstruction**2, rel=0.01)
    assert bokeh[16, 16] == 0
