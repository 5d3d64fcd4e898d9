"""Chief rays in a capture: the nearest pixels, their surfaces continued, and motion as the lens shows it."""

import numpy as np
import pytest
import scipy

from lenses import fine_grid_lens, make_lens
from lensfield.engine.field.chief_rays import ChiefRays
from lensfield.engine.field.field_map import field_map
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import Projection

NM = 550.0
LENS = make_lens(real_height_mm=lambda nm, p: p - 0.03 * p**3)
SQUEEZED = fine_grid_lens(source_mm=lambda nm, x, y: (x * (1 + 0.01 * y**2), y * (1 + 0.02 * x**2)), squeeze=1.5)
FRAME = PixelGrid((50, 70), 40.0, centre_px=(21.3, 38.6))
OTHER_FOCUS_MM = 1.1 * LENS.capture_focal_length_mm  # as of a capture that serves several frames
CAPTURES = {
    "plane": (LENS, PixelGrid((78, 104), 40.0, centre_px=(35.9, 55.2), focal_mm=LENS.capture_focal_length_mm)),
    "panorama": (LENS, PixelGrid((70, 94), 40.0, centre_px=(32.2, 49.7), focal_mm=OTHER_FOCUS_MM,
                                 projection=Projection((1.0, 0.01)))),
    "squeezed": (SQUEEZED, PixelGrid((78, 138), 40.0, centre_px=(35.9, 73.2), focal_mm=OTHER_FOCUS_MM, squeeze=1.2))}


@pytest.fixture(params=CAPTURES)
def lens(request):
    return CAPTURES[request.param][0]


@pytest.fixture
def capture(request, lens):
    return CAPTURES[request.node.callspec.params["lens"]][1]


def source_px(lens, capture, x_mm, y_mm):
    """Rows and columns in a capture of the light at places on the sensor."""
    return capture.index_of(*field_map(lens).at_wavelength(NM).source_mm(x_mm, y_mm, capture))


@pytest.fixture
def rays(lens, capture):
    return ChiefRays(lens, FRAME, capture, NM)


@pytest.fixture
def places_px(lens, capture):
    x_mm, y_mm = FRAME.axes_mm()
    return source_px(lens, capture, x_mm[None], y_mm[:, None])


def test_nearest_values_are_those_of_one_pixel_in_their_type(capture, rays, places_px):
    row, column = places_px
    numbers = np.arange(np.prod(capture.shape_px), dtype=np.int32).reshape(capture.shape_px)
    nearest = rays.nearest(numbers)
    assert nearest.dtype == np.int32
    away = np.divmod(nearest, capture.shape_px[1])
    assert np.abs(away[0] - row).max() <= 0.5 and np.abs(away[1] - column).max() <= 0.5


def test_a_plane_continues_exactly_and_an_edge_is_not_mixed(capture, rays, places_px):
    row, column = places_px
    rows, columns = np.indices(capture.shape_px, float)
    plane = 2.0 * columns - 3.0 * rows
    np.testing.assert_allclose(rays.continued(plane), 2.0 * column - 3.0 * row, atol=1e-9)
    edge = 50
    stepped = np.where(columns < edge, plane, plane + 1000)
    expected = np.where(np.rint(column) < edge, 2.0 * column - 3.0 * row, 2.0 * column - 3.0 * row + 1000)
    np.testing.assert_allclose(rays.continued(stepped), expected, atol=1e-9)


def test_next_to_pixels_without_a_surface_the_other_neighbour_decides(capture, rays, places_px):
    row, column = places_px
    rows, columns = np.indices(capture.shape_px, float)
    plane, known = 0.01 * (columns - 50) + 0.002 * rows, columns >= 50  # 0 as a value would lie near the plane
    continued = rays.continued(np.where(known, plane, np.nan))
    shown = np.rint(column) >= 50
    np.testing.assert_allclose(continued[shown], (0.01 * (column - 50) + 0.002 * row)[shown], atol=1e-12)
    assert np.isnan(continued[~shown]).all()


def test_values_stay_within_those_of_the_neighbours(capture, rays):
    noise = np.random.default_rng(4).normal(size=capture.shape_px)
    apart = rays.continued(noise) - rays.nearest(noise)
    assert np.abs(apart).max() <= np.ptp(noise) and np.any(apart)
    spike = np.zeros(capture.shape_px)
    spike[30, 40] = 7.0
    assert set(np.unique(rays.continued(spike))) <= {0.0, 7.0}


def test_what_moves_in_the_capture_moves_through_the_lens(lens, capture, rays, places_px):
    """The chief ray at the end of a motion looks at its end in the capture."""
    row, column = places_px
    right_px = np.linspace(-4, 5, row.size).reshape(row.shape)
    up_px = np.full_like(right_px, 2.5)
    static = np.zeros(row.shape, bool)
    static[::7] = True
    right, up = rays.moved(np.where(static, 0, right_px), np.where(static, 0, up_px))
    assert not right[static].any() and not up[static].any()
    rows, columns = np.indices(FRAME.shape_px)
    ends = FRAME.position_mm(rows - up, columns + right)
    end_row, end_column = source_px(lens, capture, *ends)
    np.testing.assert_allclose(end_row[~static], (row - up_px)[~static], atol=1e-4)
    np.testing.assert_allclose(end_column[~static], (column + right_px)[~static], atol=1e-4)
    assert np.abs(right - right_px)[~static].max() > 0.1, "the lens bends the motion"


def test_light_from_infinity_moves_as_the_camera_turns(lens, rays):
    """The chief ray at the end of the motion looks in the turned direction, unless that is behind the camera."""
    turn = scipy.spatial.transform.Rotation.from_euler("xyz", (0.02, -0.03, 0.05)).as_matrix()
    right, up = rays.turned(turn)
    rows, columns = np.indices(FRAME.shape_px)
    x_mm, y_mm = field_map(lens).at_wavelength(NM).source_mm(*FRAME.position_mm(rows - up, columns + right))
    ends = np.stack([x_mm * lens.squeeze, y_mm, np.full(x_mm.shape, lens.capture_focal_length_mm)], axis=-1)
    ends /= np.linalg.norm(ends, axis=-1, keepdims=True)
    np.testing.assert_allclose(ends, rays.directions() @ turn.T, atol=1e-6)
    assert np.hypot(right, up).min() > 0.5
    assert not np.any(rays.turned(np.eye(3)))
    assert np.isnan(rays.turned(np.diag((-1.0, 1.0, -1.0)))).all()


def test_directions_are_those_of_the_ideal_image(lens, rays):
    x_mm, y_mm = FRAME.axes_mm()
    ideal_x_mm, ideal_y_mm = np.broadcast_arrays(
        *field_map(lens).at_wavelength(NM).source_mm(x_mm[None], y_mm[:, None]))
    towards = rays.directions()
    np.testing.assert_allclose(np.linalg.norm(towards, axis=-1), 1, rtol=1e-12)
    for axis, ideal_mm in enumerate((ideal_x_mm * lens.squeeze, ideal_y_mm)):
        np.testing.assert_allclose(towards[..., axis] / towards[..., 2], ideal_mm / lens.capture_focal_length_mm,
                                   atol=1e-6)
