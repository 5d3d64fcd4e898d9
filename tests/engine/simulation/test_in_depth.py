"""Layers through a lens: in-focus light as usual, out-of-focus light by the lens's rays, and no seam between them."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import make_grid_lens, make_lens, tinted
from lensfield.engine import ChannelCache, Options, Report, SpectralImage, simulate
from lensfield.engine.depth.depth_range import blur_per_nearness_px, blur_px
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE
from lensfield.engine.lens.entrance_pupil import focus_nearness
from lensfield.engine.library import load_lens
from lensfield.engine.rays.rings import Rings
from lensfield.engine.runtime.errors import ImageError
from refusals import refused

NM = (500.0, 600.0)
FOCUS_MM = 2000.0
SEAM = 0.005  # the visible limit; blur changes by a twelfth of a pixel from row to row
ROUGH = Options(accuracy=0.1)


@pytest.fixture(scope="module")
def lens():
    """A lens of glass that absorbs some light, and more at one end of the spectrum."""
    return tinted(load_lens("nikkor-28mm", Rings(FOCUS_MM), "standard"))


def grid_of(lens, columns=72, margin_px=24, **parts):
    width_mm, height_mm = lens.sensor_mm
    frame_px = round(columns * height_mm / width_mm), columns
    return replace(PixelGrid.around_frame(frame_px, width_mm / columns * 1e3, (margin_px, margin_px)), **parts)


def texture(grid, period_px=9.0):
    rows, columns = np.indices(grid.shape_px)
    return 2 + np.sin(2 * np.pi * rows / period_px) * np.cos(2 * np.pi * columns / period_px)


def layer(grid, light, depth_mm, alpha=1.0):
    light, depth_mm, alpha = (np.broadcast_to(each, grid.shape_px) for each in (light, depth_mm, alpha))
    return Layer(np.stack([light * alpha] * len(NM)), alpha, depth_mm)


def layered(grid, lens, *layers):
    return LayeredRadiance(layers, NM, grid, lens.capture_focal_length_mm)


def depth_of_blur(lens, grid, blur):
    """The depth that is blurred by this many pixels."""
    return 1 / (blur / blur_per_nearness_px(lens, grid.pitch_um) + focus_nearness(lens))


def differ(one, other):
    """The largest and the mean difference, relative to the mean."""
    return np.abs(one - other).max() / other.mean(), np.abs(one - other).mean() / other.mean()


@pytest.mark.sample(2)
@pytest.mark.parametrize("options", [Options(), ROUGH, Options(supersampling=2), Options(out_of_field="vignette")])
def test_layers_in_focus_match_the_flat_picture(lens, options):
    grid = grid_of(lens)
    scene = layered(grid, lens, layer(grid, texture(grid), FOCUS_MM))
    assert np.array_equal(simulate(scene, lens, options).cube, simulate(scene.flat(), lens, options).cube)


@pytest.mark.parametrize("options", [Options(), Options(supersampling=2), Options(out_of_field="vignette")])
def test_layers_in_finer_columns_through_a_lens_with_a_squeeze(options):
    """Columns with the light of the sensor's pixel give the same picture, in focus and out of it. A lens that moves the
    picture by half a pixel shows the light in the right half of each pixel on one pixel."""
    def moving(x_px):
        return tinted(make_grid_lens(source_mm=lambda nm, x, y: (x + x_px * 0.016, y), object_distance_mm=FOCUS_MM,
                                     magnification=-0.005, squeeze=2.0))

    grid = PixelGrid((70, 90), 16.0, centre_px=(30.0, 52.0), overscan_px=(6, 6), squeeze=2.0)
    light = texture(grid)

    def image(columns, lens, depth_mm=FOCUS_MM):
        fine, within = grid.finer_across(len(columns)), np.repeat(light, len(columns), axis=1) * np.tile(columns, 90)
        scene = LayeredRadiance((layer(fine, within, depth_mm),), NM, fine, lens.capture_focal_length_mm)
        return simulate(scene, lens, options)

    for depth_mm, tolerance in ((FOCUS_MM, 1e-6), (150.0, 5e-3)):
        coarse, even = (image(columns, moving(0.5), depth_mm) for columns in ((1,), (1, 1, 1, 1)))
        assert even.grid == coarse.grid and even.frame_px == (58, 78)
        assert differ(even.cube, coarse.cube)[1] < tolerance
    rows, columns = slice(6, -6), slice(6, -6)
    expected, halved, uneven = (image(*each).cube[:, rows, columns] for each in (
        ((1,), moving(0)), ((1,), moving(0.5)), ((0, 0, 2, 2), moving(0.5))))
    assert differ(uneven, expected)[0] < 1e-5 and differ(halved, expected)[0] > 0.1


@pytest.mark.parametrize("depth_mm", [300.0, 1000.0, 8000.0, np.inf])
def test_even_light_stays_even_at_any_depth(lens, depth_mm):
    """Except near the axis, where PSFs rotate from pixel to pixel."""
    grid = grid_of(lens, margin_px=60)
    scene = layered(grid, lens, layer(grid, 3.0, depth_mm))
    most, mean = differ(simulate(scene, lens).cube, simulate(scene.flat(), lens).cube)
    assert mean < 1e-3 and most < 0.01


@pytest.mark.parametrize("out_of_field", ["vignette", "hold"])
def test_light_in_and_out_of_focus_ends_where_the_lens_data_end(out_of_field):
    """Data to 0.5 mm from an axis off the picture's centre; the picture extends to 1 mm."""
    lens = tinted(make_lens(heights_mm=np.linspace(0, 0.5, 6), object_distance_mm=FOCUS_MM, magnification=-0.005))
    grid = PixelGrid((70, 90), 16.0, centre_px=(30.0, 52.0), overscan_px=(6, 6))
    frame = grid.frame()
    x_mm, y_mm = frame.axes_mm()
    radius_mm = np.hypot(x_mm, y_mm[:, None])
    for depth_mm in (FOCUS_MM, 150.0):
        scene = LayeredRadiance((layer(grid, 3.0, depth_mm),), NM, grid, lens.capture_focal_length_mm)
        irradiance = simulate(scene, lens, Options(out_of_field=out_of_field)).cube
        lit = irradiance > 1e-4 * irradiance.max()  # above the rounding of transforms
        assert np.all(lit[:, radius_mm < 0.48]) and radius_mm.max() > 0.8
        assert np.all(lit[:, radius_mm > 0.52] == (out_of_field == "hold"))


def test_nothing_is_lit_beyond_the_end_of_the_light():
    """As above, for lens data whose last height is dark: whatever the option, and nothing is reported missing."""
    lens = tinted(make_lens(heights_mm=np.linspace(0, 0.5, 6), object_distance_mm=FOCUS_MM, magnification=-0.005,
                            relative_illumination=lambda nm, p: (p < 0.45).astype(float)))
    grid = PixelGrid((70, 90), 16.0, centre_px=(30.0, 52.0), overscan_px=(6, 6))
    x_mm, y_mm = grid.frame().axes_mm()
    radius_mm = np.hypot(x_mm, y_mm[:, None])
    for depth_mm in (FOCUS_MM, 150.0):
        scene, report = LayeredRadiance((layer(grid, 3.0, depth_mm),), NM, grid, lens.capture_focal_length_mm), Report()
        irradiance = simulate(scene, lens, report=report).cube
        assert np.all(irradiance[:, radius_mm < 0.38] > 0.5 * irradiance.max())
        assert np.all(irradiance[:, radius_mm > 0.52] < 1e-4 * irradiance.max())
        assert report.lens_image.out_of_field_fraction == 0


def test_an_even_plane_tilted_through_focus_shows_no_seam(lens):
    """From well in front of the focus to well behind it: no seam where rays begin, and none where layers do."""
    grid = grid_of(lens)
    pitch_um = grid.pitch_um / 40  # a small part of the sensor, so that the blur is many pixels wide
    grid = replace(grid, pitch_um=pitch_um)
    blur = np.linspace(-4, 4, grid.shape_px[0])[:, None]
    depth_mm = np.broadcast_to(depth_of_blur(lens, grid, blur), grid.shape_px)
    one = layered(grid, lens, layer(grid, 3.0, depth_mm))
    near, far = depth_mm < depth_of_blur(lens, grid, 2.2), depth_mm > depth_of_blur(lens, grid, 3.2)  # they overlap
    cut = layered(grid, lens, layer(grid, 3.0, depth_mm, near), layer(grid, 3.0, depth_mm, far))
    flat = simulate(one.flat(), lens).cube
    for scene in (one, cut):
        rows = (simulate(scene, lens).cube / flat).mean(axis=2)
        assert np.abs(rows - 1).max() < SEAM


def test_a_lamp_out_of_focus_keeps_its_light_and_has_its_first_order_width(lens):
    grid = grid_of(lens, columns=144)
    grid = replace(grid, pitch_um=grid.pitch_um / 10)
    light = np.zeros(grid.shape_px)
    row, column = (n // 2 for n in grid.shape_px)
    light[row - 1:row + 2, column - 1:column + 2] = 100.0
    scene = layered(grid, lens, layer(grid, light, depth_of_blur(lens, grid, 16.0)))
    report = Report()
    sharp, image = simulate(scene.flat(), lens).cube, simulate(scene, lens, Options(accuracy=0.001), report=report).cube
    assert np.allclose(image.sum(axis=(1, 2)), sharp.sum(axis=(1, 2)), rtol=0.02)
    rows, columns = np.indices(image.shape[1:])
    for plane, before in zip(image, sharp, strict=True):
        middle = [np.average(index, weights=plane) for index in (rows, columns)]
        expected = [np.average(index, weights=before) for index in (rows, columns)]
        assert np.allclose(middle, expected, atol=0.2)
        square = np.average((rows - middle[0])**2 + (columns - middle[1])**2, weights=plane)
        lamp = 2 * (3**2 - 1) / 12 + 2 / 12
        assert 4 * np.sqrt(2 * (square - lamp)) / 2 == pytest.approx(16, rel=0.05)
    energy = report.lens_image.energy
    assert energy.in_frame_w_per_nm == pytest.approx(energy.in_w_per_nm, rel=1e-3)


def test_a_blurred_edge_in_front_passes_half_of_the_light_in_focus(lens):
    grid = grid_of(lens)
    grid = replace(grid, pitch_um=grid.pitch_um / 10)
    left = np.indices(grid.shape_px)[1] < grid.shape_px[1] // 2
    near = layer(grid, 0.0, depth_of_blur(lens, grid, 20.0), left.astype(float))
    covered = simulate(layered(grid, lens, near, layer(grid, 3.0, FOCUS_MM)), lens).cube
    open_ = simulate(layered(grid, lens, layer(grid, 3.0, FOCUS_MM)), lens).cube
    across = (covered / open_).mean(axis=(0, 1))
    middle = across.size // 2
    assert across[:middle - 12].max() < 0.02 and across[middle + 12:].min() > 0.98
    assert across[middle - 1:middle + 1].mean() == pytest.approx(0.5, abs=0.03)
    assert np.all(np.diff(across) > -0.03)


def test_layers_of_another_pinhole_map_to_the_same_sensor(lens):
    """As in a rack focus, where the lens is focused elsewhere than for the capture."""
    grid, times = grid_of(lens), 1.05
    depth_mm = depth_of_blur(lens, grid_of(lens), 3.0)
    pictures = []
    for scale in (1.0, times):
        y, x = np.indices(grid.shape_px) - np.array(grid.centre_px)[:, None, None]
        light = 2 + np.sin(x / scale / 5) * np.cos(y / scale / 7)
        scene = LayeredRadiance((layer(grid, light, depth_mm),), NM, grid, scale * lens.capture_focal_length_mm)
        pictures.append(simulate(scene, lens, Options(accuracy=0.001)).cube)
    assert differ(*pictures)[0] < 0.01


@pytest.mark.parametrize("parts", [{"centre_px": (20.0, 90.0)}, {"projection": FISHEYE}])
def test_even_layers_stay_even_for_any_axis_and_projection(lens, parts):
    grid = grid_of(lens, **parts)
    scene = layered(grid, lens, layer(grid, 3.0, 400.0, np.indices(grid.shape_px)[0] % 8 < 4),
                    layer(grid, 3.0, FOCUS_MM))
    inner = (slice(None), slice(6, -6), slice(6, -6))
    assert differ(simulate(scene, lens).cube[inner], simulate(scene.flat(), lens).cube[inner])[0] < 0.02


@pytest.mark.parametrize("depth_mm", [300.0, FOCUS_MM])
def test_progress_rises_to_the_end(lens, depth_mm):
    grid, fractions = grid_of(lens), []
    scene = layered(grid, lens, layer(grid, texture(grid), depth_mm))
    simulate(scene, lens, progress=fractions.append)
    assert fractions == sorted(fractions) and fractions[-1] == 1 and fractions[0] > 0
    assert depth_mm == FOCUS_MM or len(fractions) > len(NM)  # casting reports its own progress


def test_frames_share_the_cache(lens):
    grid, cache = grid_of(lens), ChannelCache()
    scene = layered(grid, lens, layer(grid, texture(grid), 700.0))
    first = simulate(scene, lens, cache=cache).cube
    assert np.array_equal(first, simulate(scene, lens, cache=cache).cube)
    assert np.array_equal(first, simulate(scene, lens).cube)


def test_fireflies_in_layers_are_refused_or_clamped(lens):
    grid = grid_of(lens)
    light = np.full(grid.shape_px, 3.0)
    light[30, 40] = np.nan
    scene = layered(grid, lens, layer(grid, 1.0, 400.0, 0.0), layer(grid, light, 900.0))
    with refused(ImageError, field="pixel at row 30, column 40, 500 nm", value="nan", where="image"):
        simulate(scene, lens)
    report = Report()
    mended = simulate(scene, lens, Options(fireflies="clamp"), report=report).cube
    assert report.lens_image.fireflies_clamped == len(NM) and np.isfinite(mended).all()


def test_the_result_can_be_written_to_a_given_array(lens):
    grid = grid_of(lens)
    scene = layered(grid, lens, layer(grid, texture(grid), 900.0))
    out = np.empty((len(NM), *grid.frame_px), np.float32)
    assert simulate(scene, lens, out=out).cube is out
    assert isinstance(scene.flat(), SpectralImage) and blur_px(lens, grid.pitch_um, 900.0) > 0
