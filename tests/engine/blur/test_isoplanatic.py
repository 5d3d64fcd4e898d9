"""Section filtering against plain convolution and against the exact operator."""

import numpy as np
import pytest
from scipy.signal import fftconvolve

from lenses import placed_psfs
from lensfield.engine import Lens
from lensfield.engine.blur.exact import filter_exactly
from lensfield.engine.blur.isoplanatic import ORDERS, FourierSections, axis_nodes
from lensfield.engine.blur.overlap_add import overlap_add
from lensfield.engine.blur.section_needs import judge_content
from lensfield.engine.room import Room

RADIUS = 3
SHAPES = [(1, 1), (1, 9), (7, 1), (20, 33), (31, 17), (32, 32)]


def one_psf(rows, columns):
    """The same lopsided PSF everywhere."""
    psf = np.random.default_rng(7).random((2 * RADIUS + 1, 2 * RADIUS + 1))
    return np.broadcast_to(psf / psf.sum(), (len(rows), *psf.shape))


def varying_psf(rows, columns, radius=RADIUS):
    """A Gaussian whose width and place drift smoothly over the plane."""
    offset = np.arange(-radius, radius + 1)
    sigma = 0.8 + 0.3 * np.sin(np.asarray(rows) / 40)[:, None, None]
    shift = 0.5 * np.cos(np.asarray(columns) / 30)[:, None, None]
    psf = np.exp(-((offset[:, None] - shift)**2 + (offset + shift)**2) / (2 * sigma**2))
    return psf / psf.sum(axis=(1, 2), keepdims=True)


def blurred(plane, section_size, order, psfs=varying_psf, radius=RADIUS, space_px=None, single_range=0, **how):
    """A plane through its sections, in double precision unless a `single_range` is given."""
    content = judge_content(plane[None], section_size, radius, single_range, flat_slope=0, folded=False)
    space_px = space_px or section_size + 2 * radius
    sections = FourierSections(plane.shape, section_size, order, space_px, radius, psfs, Room(0), **how)
    return overlap_add(plane[None], sections, content)[0]


def noise(shape):
    return np.random.default_rng(11).random(shape)


def relative_error(result, truth):
    return np.linalg.norm(result - truth) / np.linalg.norm(truth)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("section_size", [1, 2, 7, 32])
def test_weights_of_every_pixel_sum_to_one(section_size, order):
    weights = axis_nodes(10, section_size, order).weights
    assert weights.shape == (order, section_size)
    np.testing.assert_allclose(weights.sum(axis=0), 1, atol=1e-14)


@pytest.mark.parametrize("order", [1, 2])
def test_low_orders_have_no_negative_weights(order):
    assert axis_nodes(10, 32, order).weights.min() >= 0


@pytest.mark.parametrize("order", ORDERS)
def test_weights_reproduce_polynomials_below_their_order(order):
    nodes = axis_nodes(30, 10, order)
    for section, members in enumerate(nodes.of_section):
        pixels = np.arange(10) + 10 * section
        for power in range(order):
            interpolated = nodes.positions[members]**power @ nodes.weights
            np.testing.assert_allclose(interpolated, pixels.astype(float)**power, atol=1e-9)


def test_order_2_weights_are_linear_between_the_section_edges():
    np.testing.assert_allclose(axis_nodes(4, 4, 2).weights,
                               [[7 / 8, 5 / 8, 3 / 8, 1 / 8], [1 / 8, 3 / 8, 5 / 8, 7 / 8]])


def test_nodes_are_section_middles_or_the_edges_they_share():
    np.testing.assert_allclose(axis_nodes(8, 4, 1).positions, [1.5, 5.5])
    np.testing.assert_allclose(axis_nodes(8, 4, 2).positions, [-0.5, 3.5, 7.5])
    np.testing.assert_allclose(axis_nodes(9, 4, 1).positions, [1.5, 5.5, 9.5])
    assert axis_nodes(8, 4, 2).of_section.tolist() == [[0, 1], [1, 2]]


@pytest.mark.parametrize("order", [1, 3])
def test_a_node_in_the_middle_of_a_section_is_so_to_the_last_digit(order):
    # Next to the axis a direction is made of rounding: a node that should be on it must be on it.
    assert axis_nodes(4, 1, order).positions[order // 2::order].tolist() == [0, 1, 2, 3]


def test_order_3_nodes_are_those_of_chebyshev():
    np.testing.assert_allclose(axis_nodes(2, 2, 3).positions, 0.5 + np.array([-1, 0, 1]) * np.sqrt(3) / 2, atol=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("section_size", [1, 7, 16, 50])
def test_an_isoplanatic_lens_is_a_plain_convolution(section_size, order, shape):
    plane = noise(shape)
    truth = fftconvolve(plane, one_psf([0], [0])[0], mode="full")
    np.testing.assert_allclose(blurred(plane, section_size, order, one_psf), truth, atol=1e-13)


@pytest.mark.parametrize("shape", SHAPES)
def test_sections_of_one_pixel_are_the_exact_operator(shape):
    plane = noise(shape)
    np.testing.assert_allclose(blurred(plane, 1, 1), filter_exactly(plane, RADIUS, varying_psf), atol=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("section_size", [1, 7, 50])
def test_the_canvas_holds_all_light(section_size, order, shape):
    plane = noise(shape)
    canvas = blurred(plane, section_size, order)
    assert canvas.shape == (shape[0] + 2 * RADIUS, shape[1] + 2 * RADIUS)
    assert canvas.sum() == pytest.approx(plane.sum(), rel=1e-12)


@pytest.mark.parametrize("order", ORDERS)
def test_error_falls_with_the_section_size_to_the_order(order):
    plane = noise((64, 96)) - 0.5
    truth = filter_exactly(plane, RADIUS, varying_psf)
    errors = [relative_error(blurred(plane, size, order), truth) for size in (16, 8, 4)]
    ratios = [errors[0] / errors[1], errors[1] / errors[2]]
    np.testing.assert_allclose(ratios, 2.0**order, rtol=0.15)


@pytest.mark.parametrize("order", ORDERS)
def test_a_larger_space_changes_nothing(order):
    plane = noise((20, 30))
    np.testing.assert_allclose(blurred(plane, 8, order, space_px=64), blurred(plane, 8, order), atol=1e-14)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("row, column", [(0, 0), (0, 3), (3, 0), (3, 3), (4, 4), (9, 11)])
def test_a_point_in_a_section_corner_does_not_wrap_around(row, column, order):
    radius = 6  # reaches further than a section of 4
    plane = np.zeros((10, 12))
    plane[row, column] = 5.0
    canvas = blurred(plane, 4, order, lambda r, c: varying_psf(r, c, radius), radius)
    lit = np.zeros(canvas.shape, dtype=bool)
    lit[row:row + 2 * radius + 1, column:column + 2 * radius + 1] = True
    assert np.abs(canvas[~lit]).max(initial=0) < 1e-14
    assert canvas[lit].sum() == pytest.approx(5.0, rel=1e-13)


@pytest.mark.parametrize("order", [1, 2])
def test_light_never_turns_negative_beside_a_highlight(order):
    plane = np.full((40, 40), 1e-3)
    plane[19, 23] = 1e6
    canvas = blurred(plane, 16, order)
    assert canvas.min() > -1e-9  # 1e-15 of the highlight
    assert canvas[RADIUS:-RADIUS, RADIUS:-RADIUS].min() > 0.2e-3  # a corner pixel keeps about a quarter


@pytest.mark.parametrize("order", [3, 4])
@pytest.mark.parametrize("section_size", [1, 2, 7, 12, 32])
def test_non_negative_weights_are_never_negative_and_sum_to_one(section_size, order):
    nodes = axis_nodes(100, section_size, order, non_negative=True)
    assert nodes.weights.min() >= 0
    np.testing.assert_allclose(nodes.weights.sum(axis=0), 1, atol=1e-14)


def test_non_negative_nodes_lie_evenly_from_edge_to_edge_and_are_shared():
    nodes = axis_nodes(12, 6, 3, non_negative=True)
    np.testing.assert_allclose(nodes.positions, [-0.5, 2.5, 5.5, 8.5, 11.5])
    assert nodes.of_section.tolist() == [[0, 1, 2], [2, 3, 4]]
    sixths = [[5, 3, 1, 0, 0, 0], [1, 3, 5, 5, 3, 1], [0, 0, 0, 1, 3, 5]]
    np.testing.assert_allclose(nodes.weights * 6, sixths, atol=1e-14)


@pytest.mark.parametrize("order", [1, 2])
def test_orders_1_and_2_are_non_negative_as_they_are(order):
    plane = noise((20, 33))
    np.testing.assert_array_equal(blurred(plane, 8, order, non_negative=True), blurred(plane, 8, order))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("order", [3, 4])
def test_non_negative_sections_of_an_isoplanatic_lens_are_a_plain_convolution(order, shape):
    plane = noise(shape)
    truth = fftconvolve(plane, one_psf([0], [0])[0], mode="full")
    np.testing.assert_allclose(blurred(plane, 16, order, one_psf, non_negative=True), truth, atol=1e-13)


@pytest.mark.parametrize("shape", [(1, 9), (20, 33), (48, 24)])
@pytest.mark.parametrize("order", [3, 4])
def test_non_negative_order_p_is_bilinear_interpolation_in_sections_of_one_p_minus_1th(order, shape):
    plane = noise(shape)
    finer = blurred(plane, 24 // (order - 1), 2)
    np.testing.assert_allclose(blurred(plane, 24, order, non_negative=True), finer, atol=1e-13)


@pytest.mark.parametrize("order", [3, 4])
def test_non_negative_error_falls_with_the_square_of_the_section_size(order):
    plane = noise((64, 96)) - 0.5
    truth = filter_exactly(plane, RADIUS, varying_psf)
    errors = [relative_error(blurred(plane, size, order, non_negative=True), truth) for size in (24, 12, 6)]
    np.testing.assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], 4.0, rtol=0.15)


def far_apart_psf(rows, columns):
    """A point that moves by a pixel every 2 px: between nodes far apart, Lagrange weights below zero show as such."""
    psf = np.zeros((len(rows), 2 * RADIUS + 1, 2 * RADIUS + 1))
    psf[np.arange(len(rows)), RADIUS, np.clip((np.asarray(columns) // 2).astype(int) % 7, 0, 6)] = 1
    return psf


@pytest.mark.parametrize("order", [3, 4])
def test_light_turns_negative_at_orders_3_and_4_but_not_in_the_non_negative_mode(order):
    plane = np.zeros((24, 24))
    plane[11, 1] = 1e6
    assert blurred(plane, 12, order, far_apart_psf).min() < -1e4
    assert blurred(plane, 12, order, far_apart_psf, non_negative=True).min() > -1e-9  # 1e-15 of the highlight


@pytest.mark.parametrize("order", ORDERS)
def test_single_precision_serves_pictures_of_little_contrast(order):
    plane = 1 + noise((40, 50))
    double, single = blurred(plane, 16, order), blurred(plane.astype(np.float32), 16, order, single_range=np.inf)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, double, atol=2e-6 * double.max())
    assert np.abs(single - double).max() > 1e-10  # or it was none


@pytest.mark.parametrize("space_px", [None, 32, 128])
def test_rounding_stays_within_reach_of_a_highlight_whatever_the_space(space_px):
    """Bright light all over one section and all that it reaches, dim light beyond: single precision serves there, but
    what a larger space holds beyond the reach of the PSF is nothing but the rounding of bright light."""
    plane = np.full((16, 160), 1e-3, dtype=np.float32)
    plane[:, :64] = 1e6
    result = blurred(plane, 16, 2, one_psf, space_px=space_px, single_range=1e3)
    truth = blurred(plane.astype(float), 16, 2, one_psf)
    dim = (slice(2 * RADIUS, -2 * RADIUS), slice(64 + 2 * RADIUS + 1, -2 * RADIUS))
    np.testing.assert_allclose(result[dim], truth[dim], rtol=1e-5)


@pytest.mark.parametrize("order", ORDERS)
def test_a_black_plane_stays_black(order):
    assert not blurred(np.zeros((20, 20)), 8, order).any()


def test_blurring_is_linear():
    first, second = noise((20, 30)), noise((30, 20)).T
    both = blurred(first + 3 * second, 8, 2)
    np.testing.assert_allclose(both, blurred(first, 8, 2) + 3 * blurred(second, 8, 2), atol=1e-13)


def test_order_2_leaves_no_seam_where_order_1_does():
    # Uniform light stays even where PSFs change slowly; hard sections show their edges.
    hard, smooth = (np.abs(np.diff(blurred(np.ones((64, 64)), 16, order)[8:-8, 8:-8], axis=1)).max()
                    for order in (1, 2))
    assert smooth < hard / 4


def edmund_psfs(pitch_um, centre_px):
    return placed_psfs(Lens.load("edmund-54852"), 587.6, pitch_um, centre_px)


@pytest.fixture(scope="module")
def edmund_errors():
    """Relative error by order on a corner of the frame, 1.4 to 1.9 mm from the axis, for sections of 16, 8 and 4."""
    plane = noise((48, 64)) - 0.5
    psfs, radius = edmund_psfs(6.25, (175, -185))
    truth = filter_exactly(plane, radius, psfs)
    return {order: [relative_error(blurred(plane, size, order, psfs, radius), truth) for size in (16, 8, 4)]
            for order in (1, 2)}


def test_edmund_error_of_order_1_halves_with_the_section(edmund_errors):
    sixteen, eight, four = edmund_errors[1]
    assert sixteen / eight == pytest.approx(2.0, abs=0.2) and eight / four == pytest.approx(2.0, abs=0.2)


def test_edmund_error_of_order_2_falls_faster_than_the_section(edmund_errors):
    # Smooth PSFs would give 4. Tabulated ones have kinks, at the table's heights and where samples cross pixels; of a
    # kink only the sections that it runs through know: size^1.5, a factor of 2.8.
    sixteen, eight, four = edmund_errors[2]
    assert 2.5 < sixteen / eight < 4.5 and 2.5 < eight / four < 4.5


def test_edmund_order_2_is_far_more_accurate_than_order_1(edmund_errors):
    assert all(second < first / 4 for first, second in zip(edmund_errors[1], edmund_errors[2]))


def test_edmund_section_of_one_pixel_is_the_exact_operator():
    plane = noise((16, 20))
    psfs, radius = edmund_psfs(6.25, (100, -80))
    np.testing.assert_allclose(blurred(plane, 1, 1, psfs, radius), filter_exactly(plane, radius, psfs), atol=1e-12)


def test_only_the_otfs_that_lit_sections_need_are_made():
    asked = []

    def counted(rows, columns):
        asked.extend(zip(rows, columns))
        return one_psf(rows, columns)

    plane = np.zeros((40, 40))
    plane[12, 25] = 1  # in section (1, 2) of 10 px: the nodes are its corners
    blurred(plane, 10, 2, counted)
    assert sorted(asked) == [(9.5, 19.5), (9.5, 29.5), (19.5, 19.5), (19.5, 29.5)]


def test_nodes_that_sections_share_are_made_once():
    asked = []

    def counted(rows, columns):
        asked.extend(zip(rows, columns))
        return one_psf(rows, columns)

    blurred(noise((40, 30)), 10, 2, counted)
    assert len(asked) == len(set(asked)) == 5 * 4


def test_otfs_that_are_kept_are_not_made_again_and_change_nothing():
    asked = []

    def counted(rows, columns):
        asked.extend(zip(rows, columns))
        return varying_psf(rows, columns)

    sections = FourierSections((30, 40), 10, 2, 16, RADIUS, counted, Room(1e9))
    first, second = noise((30, 40))[None], np.zeros((1, 30, 40))
    second[0, 3, 4] = 7
    results = []
    for plane in (second, first, second):
        results.append(overlap_add(plane, sections, judge_content(plane, 10, RADIUS, 0, 0, False)))
    assert len(asked) == len(set(asked)) == 4 * 5
    np.testing.assert_array_equal(results[0], results[2])
    np.testing.assert_array_equal(results[1][0], blurred(first[0], 10, 2))
