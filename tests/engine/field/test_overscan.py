"""Captures: the overscan around the frame, and panoramas equivalent to plane captures."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import PIXEL_BY_PIXEL, gaussian_psf, lit_pixels, make_lens
from lensfield.engine import Options, SpectralImage, load_lens, simulate
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.overscan import MOST_PLANE, choose_capture, lens_projection
from lensfield.engine.field.psf_samples import psf_radius_px
from lensfield.engine.field.radial.capture import capture_radius
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import FISHEYE, PLANE, Projection
from varied_lenses import varied_lens

E_AXIS = np.pi / 16
SECTIONS = Options(section_size=16)
PANORAMA = Projection((0.9, 0.1, -0.15, 0.06))


def lens_of(real_height_mm=None, last_mm=3.0, focal_mm=2.0, **changes):
    """A lens focused at infinity: heights are focal_mm times the tangent of the angle."""
    heights = np.linspace(0, last_mm, 31)
    return make_lens(real_height_mm=real_height_mm and (lambda nm, p: real_height_mm(p)), heights_mm=heights,
                     efl_mm=focal_mm, object_distance_mm=np.inf, magnification=0.0, **changes)


def barrel(p):
    """8 % barrel distortion at 2 mm."""
    return p - 0.02 * p**3


def fisheye(p):
    """An equidistant lens of 2 mm: a point at 56 degrees, 3 mm, lands at 1.97 mm."""
    return 2 * np.arctan(p / 2)


@pytest.mark.parametrize("scale, rows, columns", [(0.9, 55 / 0.9 - 50, 105 / 0.9 - 100), (1.0, 5, 5), (1.2, 5, 5)])
def test_overscan_covers_distortion_and_blur_with_little_excess(scale, rows, columns):
    lens = make_lens(real_height_mm=lambda nm, p: scale * p)
    overscan = field_map(lens).overscan_px(PixelGrid((100, 200), 10.0), [550.0], 5)
    assert rows <= overscan[0] <= rows + 2
    assert columns <= overscan[1] <= columns + 2


def test_overscan_covers_the_most_demanding_wavelength():
    lens = make_lens(real_height_mm=lambda nm, p: p * np.where(nm < 500, 0.8, 1.0))
    frame = PixelGrid((100, 100), 10.0)
    assert field_map(lens).overscan_px(frame, [400, 700], 0) == field_map(lens).overscan_px(frame, [400], 0)


def test_overscan_for_barrel_is_set_by_the_corner():
    # Half a frame is 100 x 100 px of 10 um: its corner is sqrt(2) mm from the axis.
    lens = make_lens(real_height_mm=lambda nm, p: barrel(p), heights_mm=np.linspace(0, 2.5, 26))
    corner_paraxial = next(p for p in np.linspace(1.41, 1.6, 100001) if barrel(p) >= np.sqrt(2))
    needed = 100 * corner_paraxial / np.sqrt(2) - 100
    assert needed <= field_map(lens).overscan_px(PixelGrid((200, 200), 10.0), [550], 0)[0] <= needed + 2


@pytest.mark.parametrize("scale", [0.3, 0.7, 1.0])
def test_overscan_of_a_fisheye_capture_is_the_arc_to_the_middle_of_an_edge(scale):
    # The light at real height r comes from r / scale, at 2 mm times the angle in the capture: on an edge, farthest at
    # its middle. Half a frame is 50 x 100 px of 10 um, and the PSFs reach 3 px.
    frame = PixelGrid((100, 200), 10.0, projection=FISHEYE)
    overscan = field_map(lens_of(lambda p: scale * p, last_mm=6)).overscan_px(frame, [550.0], 3)
    for margin, half in zip(overscan, (50, 100), strict=True):
        needed = max(200 * np.arctan((half + 3) * 0.01 / scale / 2), half + 3) - half
        assert needed <= margin <= needed + 2


@pytest.mark.parametrize("scale", [1.2, 1.0, 0.96, 0.92, 0.7, 0.2])
def test_a_panorama_is_chosen_if_a_plane_has_more_than_1_15_times_its_pixels(scale):
    """The lens shows all heights scaled down. Then a panorama needs overscan for blur alone, and a pixel for safety."""
    assert MOST_PLANE == 1.15
    lens = lens_of(lambda p: scale * p, last_mm=12)
    frame = PixelGrid((100, 200), 10.0)
    chosen = choose_capture(lens, frame, [550.0], 4)
    plane = [n + 2 * margin for n, margin in
             zip((100, 200), field_map(lens).overscan_px(frame, [550.0], 4), strict=True)]
    assert chosen.projection.is_plane == (np.prod(plane) <= 1.15 * 110 * 210)
    assert chosen.frame_px == (100, 200) and chosen.centred
    assert chosen.overscan_px == field_map(lens).overscan_px(chosen, [550.0], 4)
    assert chosen.projection.is_plane or max(chosen.overscan_px) <= 6


def test_an_equidistant_lens_is_captured_by_an_equidistant_panorama():
    chosen = choose_capture(lens_of(fisheye, last_mm=6), PixelGrid((320, 360), 10.0), [550.0], 4)
    assert chosen.projection.angle_rad(np.array([0.2, 0.7, 1.2])) == pytest.approx([0.2, 0.7, 1.2], abs=2e-3)
    assert max(chosen.overscan_px) <= 6  # 4 for blur, and 2 for the fit and safety


def test_the_papers_lens_needs_little_more_than_the_frame():
    """A plane has 1.4 times the frame's pixels. The PSFs reach 13 px, and colours differ by 3 px at the edge."""
    lens = load_lens("edmund-54852")
    frame = PixelGrid((576, 768), 6.25)
    chosen = choose_capture(lens, frame, lens.wavelengths_nm, psf_radius_px(lens, 6.25))
    assert not chosen.projection.is_plane and max(chosen.overscan_px) <= psf_radius_px(lens, 6.25) + 8


def test_a_projection_follows_the_lens_over_the_grid():
    """In a capture with the lens's own projection, all light is within a pixel of its place on the sensor."""
    lens = lens_of(barrel, focal_mm=5.0)
    grid = PixelGrid((200, 240), 10.0, (80.0, 130.0))
    grid = replace(grid, projection=lens_projection(lens, grid))
    x_mm, y_mm = grid.axes_mm()
    shown_mm = field_map(lens).at_wavelength(550.0).source_mm(x_mm[None, :], y_mm[:, None], grid)
    off_px = np.hypot(shown_mm[0] - x_mm[None, :], shown_mm[1] - y_mm[:, None]) / 0.01
    assert off_px.max() < 1


def fisheye_capture():
    return PixelGrid((64, 64), 10.0, projection=FISHEYE)


@pytest.mark.parametrize("times", [0.8, 1.0, 1.3])
@pytest.mark.parametrize("projection", [PLANE, FISHEYE, PANORAMA])
def test_a_capture_with_another_focal_length_gives_the_same_picture(projection, times):
    """The same as with the lens's own pinhole, within the error of bilinear look-ups in pixels of a different size."""
    lens = lens_of(lambda p: 0.97 * p, focal_mm=4.0)
    lens_grid = PixelGrid.around_frame((60, 80), 20.0, (60, 60), projection)
    other = replace(lens_grid, focal_mm=times * 4.0)
    pictures = []
    for grid in (lens_grid, other):
        x_mm, y_mm = grid.axes_mm()
        radius_mm = np.hypot(x_mm[None, :], y_mm[:, None]) * (4.0 / grid.focal_mm if grid.focal_mm else 1.0)
        tangent = 4.0 * np.tan(projection.angle_rad(radius_mm / 4.0))
        scale = np.divide(tangent, np.hypot(x_mm[None, :], y_mm[:, None]), out=np.ones(grid.shape_px),
                          where=radius_mm > 0)
        picture = 2 + np.sin(3 * scale * x_mm[None, :] + 1) * np.cos(4 * scale * y_mm[:, None])
        image = SpectralImage(picture[None], [550.0], grid)
        pictures.append(simulate(image, lens).cube[0])
    assert np.abs(pictures[0] - pictures[1]).max() < 3e-3 * pictures[0].max()


@pytest.mark.parametrize("angle_deg", [0.001, 10, 45, 80])
def test_a_fisheye_shows_an_angle_at_its_arc(angle_deg):
    angle = np.radians(angle_deg)
    radius_mm, slope = capture_radius(fisheye_capture(), lens_of(focal_mm=2.0))(2.0 * np.tan(angle))
    assert radius_mm == pytest.approx(2.0 * angle, rel=1e-12)
    assert slope == pytest.approx(np.cos(angle)**2, rel=1e-9)  # d arc / d tangent


def test_angles_are_measured_from_the_entrance_pupil():
    # The object is 95 mm from the first surface, the pupil 5 mm behind it, magnification -1/10: 10 mm of tangent.
    lens = make_lens(magnification=-0.1, object_distance_mm=95.0, entrance_pupil_mm=5.0)
    assert capture_radius(fisheye_capture(), lens)(10.0)[0] == pytest.approx(10 * np.pi / 4)


def scene(x_mm, y_mm):
    """Smooth light from many directions, by paraxial image position."""
    return 2 + np.sin(3 * x_mm + 1) * np.cos(4 * y_mm) + 0.5 * np.sin(5 * (x_mm + y_mm))


def capture(lens, projection, shape, overscan, pitch_um, centre_px=None, light=scene):
    """The scene as a camera with this projection captures it, sampled at the centres of its pixels."""
    grid = PixelGrid.around_frame(shape, pitch_um, overscan, projection)
    grid = replace(grid, centre_px=centre_px) if centre_px else grid
    x_mm, y_mm = grid.axes_mm()
    x_mm, y_mm = np.broadcast_arrays(x_mm[None, :], y_mm[:, None])
    radius_mm, focal_mm = np.hypot(x_mm, y_mm), lens.capture_focal_length_mm
    tangent_mm = focal_mm * np.tan(np.minimum(projection.angle_rad(radius_mm / focal_mm), 1.5))
    stretch = np.divide(tangent_mm, radius_mm, out=np.ones(grid.shape_px), where=radius_mm > 0)
    return SpectralImage(light(x_mm * stretch, y_mm * stretch)[None], [550.0], grid)


def overscan_needed(lens, shape, pitch_um, projection=PLANE):
    frame = PixelGrid(shape, pitch_um, projection=projection)
    return field_map(lens).overscan_px(frame, [550.0], psf_radius_px(lens, pitch_um))


def either_camera(lens, shape, pitch_um, options, centre_px=None, overscan=None, panorama=FISHEYE):
    """Pictures of the scene by a plane camera and by a panoramic camera."""
    for projection in (PLANE, panorama):
        margins = overscan or overscan_needed(lens, shape, pitch_um, projection)
        yield simulate(capture(lens, projection, shape, margins, pitch_um, centre_px), lens, options).cube[0]


STEEPEST = 12
"""The scene's slopes along x and y add up to less than 5.5 + 6.5 per mm."""
RESAMPLING = 0.0858 * 0.02 * STEEPEST * 1.1 * E_AXIS
"""A box e px wide changes slopes of uniform light by at most (e - 1)(2 - e) / 2 e px: 0.0858 at e = sqrt(2).

The pixels are 20 um. A tenth more for curvature.
"""


@pytest.mark.parametrize("shape", [(100, 120), (101, 121)])
@pytest.mark.parametrize("options", [SECTIONS, Options(method="pixels", azimuths=8)])
@pytest.mark.parametrize("blur", [None, gaussian_psf(15, 10, 5.0, 13)])
def test_plane_and_fisheye_captures_give_the_same_picture(shape, options, blur):
    lens = lens_of(fisheye) if blur is None else lens_of(fisheye, psf=blur, psf_pitch_um=5.0)
    np.testing.assert_allclose(*either_camera(lens, shape, 20.0, options), atol=RESAMPLING, rtol=0)


def test_the_difference_between_captures_falls_with_the_pitch():
    coarse, fine = (np.abs(np.subtract(*either_camera(lens_of(fisheye), (n, n), 2000 / n, SECTIONS))).max()
                    for n in (100, 200))
    assert coarse / fine > 1.7


def test_an_equidistant_lens_leaves_a_matching_fisheye_capture_unchanged():
    lens, shape = lens_of(fisheye), (61, 81)
    image = capture(lens, FISHEYE, shape, (2, 2), 20.0)
    result = simulate(image, lens, PIXEL_BY_PIXEL)
    # Except for the fit of the distortion, which is accurate to 1e-5 of 3 mm.
    np.testing.assert_allclose(result.cube, E_AXIS * image.frame().cube, atol=3e-5 * STEEPEST * E_AXIS, rtol=1e-6)


@pytest.mark.parametrize("panorama", [FISHEYE, PANORAMA])
def test_captures_agree_with_an_axis_off_centre(panorama):
    pictures = either_camera(lens_of(fisheye), (60, 80), 20.0, SECTIONS, (50.0, 95.0), (40, 40), panorama)
    np.testing.assert_allclose(*pictures, atol=RESAMPLING, rtol=0)


@pytest.mark.parametrize("x_px, y_px", [(40, 0), (0, 40), (-30, 20), (25, -35), (0, 0)])
def test_a_point_of_a_fisheye_capture_lands_by_its_direction(x_px, y_px):
    """A pixel at the arc 2 mm * angle corresponds to the height 2 mm * tan(angle), which this lens maps to 0.9 of it.
    """
    lens = lens_of(lambda p: 0.9 * p, last_mm=4)
    image = SpectralImage(np.zeros((1, 161, 161)), [550.0], pitch_um=20.0, projection=FISHEYE)
    image.cube[0, 80 - y_px, 80 + x_px] = 1
    lit = lit_pixels(simulate(image, lens, PIXEL_BY_PIXEL))
    radius_mm = 0.02 * np.hypot(x_px, y_px)
    stretch = 0.9 * 2 * np.tan(radius_mm / 2) / radius_mm if radius_mm else 0.9
    total = sum(lit.values())
    centroid = [sum(place[axis] * value for place, value in lit.items()) / total for axis in (0, 1)]
    assert centroid == pytest.approx((stretch * x_px, stretch * y_px), abs=0.3)


@pytest.mark.parametrize("projection", [PLANE, FISHEYE, PANORAMA])
def test_even_light_stays_even_with_either_capture(projection):
    lens = lens_of(fisheye)
    margins = overscan_needed(lens, (120, 160), 20.0, projection)
    image = capture(lens, projection, (120, 160), margins, 20.0, light=lambda x_mm, y_mm: np.full(x_mm.shape, 3.0))
    np.testing.assert_allclose(simulate(image, lens, SECTIONS).cube, 3 * E_AXIS, rtol=2e-6)


def test_the_projection_of_a_result_is_always_plane():
    lens = lens_of(fisheye)
    result = simulate(capture(lens, FISHEYE, (40, 40), (3, 3), 20.0), lens, SECTIONS)
    assert result.projection == PLANE


@pytest.mark.parametrize("projection", [PLANE, FISHEYE, PANORAMA])
@pytest.mark.parametrize("real_height_mm", [lambda p: p, barrel, fisheye, lambda p: 0.5 * p, lambda p: p + 0.03 * p**3,
                                            lambda p: p * (1 - 0.1 * p**2 + 0.012 * p**4)])
@pytest.mark.parametrize("shape", [(40, 55)])
def test_overscan_suffices(shape, real_height_mm, projection):
    """Light beyond the requested overscan does not change any pixel of the frame."""
    lens = lens_of(real_height_mm, psf=gaussian_psf(40, 25, 12.5, 9), psf_pitch_um=12.5)
    pitch_um = 40.0
    needed = overscan_needed(lens, shape, pitch_um, projection)
    large = tuple(margin + 11 for margin in needed)
    cube = np.random.default_rng(2).random((1, *(n + 2 * margin for n, margin in zip(shape, large, strict=True))))
    facts = dict(wavelengths_nm=[550.0], pitch_um=pitch_um, projection=projection)
    for options in (SECTIONS, Options(method="pixels", azimuths=4)):
        wide = simulate(SpectralImage(cube, overscan_px=large, **facts), lens, options)
        enough = simulate(SpectralImage(cube[:, 11:-11, 11:-11], overscan_px=needed, **facts), lens, options)
        np.testing.assert_allclose(enough.cube, wide.cube, rtol=1e-6)


def test_less_overscan_than_required_does_not_suffice():
    lens = lens_of(barrel)
    needed = overscan_needed(lens, (80, 80), 40.0)
    cubes = [np.pad(np.ones((1, 80, 80)), ((0, 0), (m, m), (m, m)), constant_values=1.0)
             for m in (needed[0], needed[0] - 4)]
    dark = [simulate(SpectralImage(cube, [550.0], pitch_um=40.0, overscan_px=2 * ((cube.shape[1] - 80) // 2,)), lens,
                     SECTIONS).cube.min() for cube in cubes]
    assert dark[0] == pytest.approx(E_AXIS, rel=1e-5) and dark[1] < 0.9 * E_AXIS


def test_a_close_focused_lens_scales_a_fisheye_capture_by_its_magnification():
    """The capture's scale on the axis is |m| (object distance + pupil), not the focal length."""
    near = replace(lens_of(fisheye), object_distance_mm=95.0, entrance_pupil_mm=5.0, magnification=-0.02)
    far = lens_of(fisheye)
    image = capture(far, FISHEYE, (41, 51), (2, 2), 20.0)
    assert near.capture_focal_length_mm == pytest.approx(far.capture_focal_length_mm)
    np.testing.assert_allclose(simulate(image, near, SECTIONS).cube, simulate(image, far, SECTIONS).cube, rtol=1e-6)


@pytest.mark.parametrize("projection", [PLANE, FISHEYE])
@pytest.mark.parametrize("bend", [-0.02, 0.0, 0.02])
def test_reach_is_the_largest_displacement_of_a_point(bend, projection):
    """It lands at p + bend p^3, in mm; a plane capture shows it at p, and a fisheye capture at f atan(p / f)."""
    lens = lens_of(lambda p: p + bend * p**3)
    grid = PixelGrid.around_frame((40, 60), 50.0, (10, 10), projection)
    p = np.linspace(0, 3, 100001)
    lands, shown = p + bend * p**3, p if projection == PLANE else 2 * np.arctan(p / 2)
    moved_px = np.abs(shown - lands)[lands <= np.hypot(20, 30) * 0.05].max() / 0.05
    assert moved_px + 7 < field_map(lens).reach_px(grid, [550.0], 7) <= moved_px + 9


@pytest.mark.parametrize("name", ["edmund-54852", "muller-fisheye-25mm", "kodak-petzval-100mm"])
@pytest.mark.parametrize("shift_px", [(40, -25), (-100, 75)])
def test_the_light_of_a_shifted_frame_is_in_its_capture(name, shift_px):
    """At the edges of the frame and its PSFs; the axis may be beyond them."""
    lens, reach_px = varied_lens(name), 3
    pitch_um = 1e3 * lens.sensor_mm[0] / 300
    capture = choose_capture(lens, PixelGrid((90, 120), pitch_um).shifted(*shift_px), [550.0], reach_px)
    assert capture.frame().centre_px == (44.5 + shift_px[1], 59.5 - shift_px[0])
    edge = capture.frame().framed(reach_px)
    rows, columns = (np.linspace(-0.5, n - 0.5, 40) for n in edge.shape_px)
    for row, column in ((rows[[0, -1], None], columns), (rows, columns[[0, -1], None])):
        x_mm, y_mm = np.broadcast_arrays(*edge.position_mm(row, column))
        places = capture.index_of(*field_map(lens).at_wavelength(550.0).source_mm(x_mm, y_mm, capture))
        for place, n in zip(places, capture.shape_px, strict=True):
            assert -0.5 <= place.min() and place.max() <= n - 0.5
