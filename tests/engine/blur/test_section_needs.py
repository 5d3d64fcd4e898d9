"""The requirements of a picture, section by section: checked by hand, and against every pixel and its reach."""

import numpy as np
import pytest

from blurring import needs_of
from lenses import comatic_lens, distance_of_light, gaussian_psf, lopsided_lens, make_lens
from lensfield.engine import Options, SpectralImage, load_lens, simulate
from lensfield.engine.blur.polar_sections import PolarSections
from lensfield.engine.blur.section_needs import section_needs
from lensfield.engine.field.mirror_symmetry import Planes
from lensfield.engine.image.pixel_grid import PixelGrid

E_AXIS = np.pi / 16
RANGE = 1024.0


def judged(plane, section_size=10, reach_px=3, single_range=RANGE, flat_slope=0.0):
    return needs_of(np.asarray(plane, dtype=float), section_size, reach_px, single_range, flat_slope)


def sections(mask):
    return {tuple(place) for place in np.argwhere(mask).tolist()}


def test_black_sections_need_nothing():
    needs = judged(np.zeros((20, 30)), flat_slope=0.1)
    assert needs.lit.shape == (2, 3)
    assert not (needs.lit.any() or needs.double.any() or needs.flat.any())


@pytest.mark.parametrize("row, column, section", [(0, 0, (0, 0)), (9, 10, (0, 1)), (10, 9, (1, 0)), (24, 30, (2, 3))])
def test_a_single_pixel_lights_only_its_section(row, column, section):
    plane = np.zeros((25, 31))
    plane[row, column] = 1e-40
    assert sections(judged(plane).lit) == {section}


def test_a_picture_smaller_than_a_section_is_one_section():
    needs = judged([[2.0]], section_size=32, reach_px=100)
    assert needs.lit.tolist() == [[True]] and needs.double.tolist() == [[False]]


@pytest.mark.parametrize("brightest, double", [(RANGE, False), (RANGE + 1, True)])
def test_single_precision_suffices_up_to_its_range(brightest, double):
    plane = np.ones((10, 10))
    plane[4, 5] = brightest
    assert judged(plane).double.tolist() == [[double]]


def test_black_pixels_do_not_count_as_dim():
    plane = np.zeros((10, 10))
    plane[4, 5], plane[2, 2] = 1e30, 1e30 / RANGE
    assert not judged(plane).double.any()


def test_a_highlight_that_reaches_dim_sections_needs_double_precision():
    plane = np.full((30, 30), 1e-3)
    plane[10:20, 10:20] = 1e6  # uniform, as are its neighbours
    needs = judged(plane)
    assert needs.lit.all() and sections(needs.double) == {(1, 1)}


@pytest.mark.parametrize("reach_px, double", [(0, False), (1, False), (10, False), (11, True), (20, True)])
def test_a_dim_section_counts_within_reach_of_the_light(reach_px, double):
    plane = np.full((10, 40), 1e6)
    plane[:, 20:] = 1e-3  # ten pixels of bright light separate section 0 from the dim ones
    assert judged(plane, reach_px=reach_px).double[0, 0] == double


@pytest.mark.parametrize("columns", [(0, 3), (3, 0)])
def test_dim_sections_count_on_either_side(columns):
    plane = np.zeros((10, 40))
    plane[5, 10 * columns[0] + 5], plane[5, 10 * columns[1] + 5] = 1e6, 1
    assert sections(judged(plane, reach_px=25).double) == {(0, columns[0])}


def test_range_0_means_double_precision_and_infinity_single():
    plane = np.zeros((20, 30))
    plane[3, 3], plane[15, 25] = 1, 1e30
    assert sections(judged(plane, single_range=0).double) == {(0, 0), (1, 2)}
    assert not judged(plane, single_range=np.inf).double.any()


def test_all_planes_share_the_section_needs():
    planes = np.zeros((4, 10, 30))
    planes[0, 5, 5], planes[3, 5, 15] = 1e6, 1
    needs = section_needs(planes, Planes(PixelGrid((20, 60), 1.0), True), 10, 3, RANGE, 0)
    assert sections(needs.lit) == {(0, 0), (0, 1)} and sections(needs.double) == {(0, 0)}


def test_even_light_is_flat_except_within_reach_of_black():
    needs = judged(np.ones((60, 60)), flat_slope=1e-9)
    assert sections(needs.flat) == {(i, j) for i in range(1, 5) for j in range(1, 5)}


def test_sections_deep_inside_flat_light_are_not_spread():
    needs = judged(np.ones((60, 60)), flat_slope=1e-9)
    assert sections(~needs.lit) == {(i, j) for i in (2, 3) for j in (2, 3)}
    border = {(i, j) for i in range(6) for j in range(6)} - {(i, j) for i in range(1, 5) for j in range(1, 5)}
    assert sections(needs.lit & ~needs.flat) == border


def test_nothing_is_flat_at_a_slope_of_zero():
    assert not judged(np.ones((60, 60)), flat_slope=0.0).flat.any()


@pytest.mark.parametrize("slope, flat", [(0.0009, False), (0.0011, True)])
@pytest.mark.parametrize("along", [0, 1])
def test_a_step_is_flat_up_to_the_slope(slope, flat, along):
    plane = np.ones((50, 50))
    plane[(slice(25, None), slice(None))[::1 if along == 0 else -1]] = 1.001
    assert judged(plane, flat_slope=slope).flat[2, 2] == flat


@pytest.mark.parametrize("column, flat", [(29, False), (30, False), (39, False), (40, True)])
def test_a_step_between_sections_or_in_the_next_one_is_detected(column, flat):
    plane = np.ones((50, 70))
    plane[:, column + 1:] = 1.1
    assert judged(plane, flat_slope=0.01).flat[2, 2] == flat


def test_a_step_is_relative_to_the_dimmest_pixel_in_reach():
    plane = np.exp(0.001 * np.arange(50))[None, :] * np.ones((50, 1))
    # Section 2 reads the columns 10 to 39, and the step beyond them: the dimmest value is exp(0.01).
    step = 0.001 * np.exp(0.0395 - 0.01)
    assert judged(plane, flat_slope=step * 1.001).flat[2, 2]
    assert not judged(plane, flat_slope=0.001).flat[2, 2]


@pytest.mark.parametrize("length", [41, 45, 49, 50])
def test_even_light_that_ends_within_reach_is_not_flat(length):
    """The last section may be only a strip of the picture, so that black is within reach of the previous section."""
    needs = judged(np.ones((50, length)), reach_px=8, flat_slope=1e-3)
    last_flat = (length - 8) // 10 - 1  # its last pixel is at least 8 px from the end
    flat_columns = np.flatnonzero(needs.flat[2]).tolist()
    assert set(range(1, last_flat)) <= set(flat_columns) <= set(range(1, last_flat + 1))


@pytest.mark.parametrize("shape", [(80, 80), (81, 80), (80, 81), (81, 81)])
def test_a_folded_picture_is_flat_across_its_axis(shape):
    needs = needs_of(np.ones(shape), 10, 8, RANGE, 1e-9, folded=True)
    assert needs.flat[:3, :3].all() and not needs.lit[:2, :2].any()


@pytest.mark.parametrize("halves", ["left and right", "upper and lower"])
@pytest.mark.parametrize("extra", [0, 1])
def test_a_step_across_the_axis_is_detected(halves, extra):
    plane = np.ones((80 + extra, 80 + extra))
    plane[(slice(None), slice(40 + extra)) if halves == "left and right" else slice(40 + extra)] = 1.1
    needs = needs_of(plane, 10, 8, RANGE, 0.01, folded=True)
    near_axis = needs.flat[:, :2] if halves == "left and right" else needs.flat[:2]
    assert not near_axis.any()
    assert (needs.flat[:2, 2] if halves == "left and right" else needs.flat[2, :2]).all()


def patchy(shape, seed):
    """Uniform light with steps of all sizes, black holes and a few highlights."""
    rng = np.random.default_rng(seed)
    plane = np.kron(1 + 0.02 * rng.integers(0, 2, (3, 3)), np.ones((15, 15)))[:shape[0], :shape[1]].copy()
    for _ in range(rng.integers(0, 4)):
        row, column = rng.integers(0, shape[0]), rng.integers(0, shape[1])
        plane[row:row + 3, column:column + 3] = rng.choice([0, 1e4, 1e-4, 1.005])
    return plane


def reached(row, column, reach_px, shape):
    return (slice(max(row - reach_px, 0), row + reach_px + 1), slice(max(column - reach_px, 0), column + reach_px + 1))


def section_of(shape, section_size, folded):
    """Section row of each row, and section column of each column, of the full picture."""
    for n in shape:
        index = np.arange(n)
        yield (np.maximum(index - n // 2, n - 1 - index - n // 2) if folded else index) // section_size


@pytest.mark.parametrize("folded", [False, True])
@pytest.mark.parametrize("shape", [(36, 40), (29, 31), (11, 40)])
@pytest.mark.parametrize("section_size, reach_px", [(6, 3), (5, 5), (7, 9), (4, 1)])
def test_every_pixel_meets_the_needs_of_its_section(shape, section_size, reach_px, folded):
    """Checks each pixel of the full picture against the requirements of its section."""
    slope = 0.01
    for seed in range(2):
        plane = patchy(shape, seed)
        needs = needs_of(plane, section_size, reach_px, RANGE, slope, folded)
        of_row, of_column = section_of(shape, section_size, folded)
        flat, lit, double = (mask[of_row[:, None], of_column] for mask in (needs.flat, needs.lit, needs.double))
        for row, column in np.ndindex(shape):
            window = reached(row, column, reach_px, shape)
            nearby = plane[window]
            complete = nearby.shape == (2 * reach_px + 1, 2 * reach_px + 1)
            if flat[row, column]:
                steps = max(np.abs(np.diff(nearby, axis=0)).max(), np.abs(np.diff(nearby, axis=1)).max())
                assert complete and steps <= slope * nearby.min()
            if lit[row, column]:
                dim = nearby[nearby > 0].min(initial=np.inf)
                assert double[row, column] or plane[row, column] <= RANGE * dim
            elif plane[row, column]:
                assert flat[window].all()  # everything that its light reaches is flat


def leaning_lens():
    """PSFs widen over the field and lean outwards, by a pixel of 16 um at 2 mm: uniform light falls by about 2 %."""
    table = np.stack([np.roll(gaussian_psf(8 + h, 8, 8.0, 9), h, axis=0) for h in range(3)])
    return make_lens(np.stack([table, table]), heights_mm=np.linspace(0, 2, 3), psf_pitch_um=8.0)


def mostly_even(centred):
    """Uniform light with a patterned border, wide enough below and to the right to place the axis off centre."""
    plane = np.ones((150, 160))
    noisy = np.random.default_rng(5).random(plane.shape)
    plane[140:], plane[:, 150:] = noisy[140:], noisy[:, 150:]
    plane[145, 155] = 50
    return SpectralImage(plane[None], 550.0, pitch_um=16.0, centre_px=None if centred else (20.0, 110.0))


@pytest.fixture(scope="module", params=[True, False], ids=["centred", "off centre"])
def even_picture(request):
    image, lens = mostly_even(request.param), leaning_lens()
    return image, lens, simulate(image, lens, Options(method="exact")).cube


@pytest.mark.parametrize("knobs", [dict(section_size=16), dict(method="pixels", azimuths=32)])
def test_flat_sections_stay_within_the_tolerance(even_picture, knobs):
    image, lens, exact = even_picture
    filtered = simulate(image, lens, Options(**knobs)).cube
    flat = simulate(image, lens, Options(**knobs, flat_tolerance=1e-3)).cube
    assert (flat != filtered).any()
    assert distance_of_light(flat, exact) <= distance_of_light(filtered, exact) + 1e-3
    assert distance_of_light(flat, filtered) <= 1e-3


def test_leaning_psfs_dim_even_light_as_with_the_exact_operator(even_picture):
    image, lens, exact = even_picture
    flat = simulate(image, lens, Options(section_size=16, flat_tolerance=1e-3)).cube
    middle = (0, slice(30, 110), slice(30, 120))
    assert 0.005 < 1 - exact[middle].mean() / E_AXIS < 0.03
    np.testing.assert_allclose(flat[middle].mean(), exact[middle].mean(), rtol=1e-3)  # within the given tolerance


@pytest.mark.parametrize("shape", [(96, 128), (97, 129)])
def test_flat_light_is_the_same_folded_and_unfolded(shape):
    """PSFs lean outwards on both sides of the axis: a missing sign would make the light there 1 % brighter."""
    lens, options = leaning_lens(), Options(section_size=8, flat_tolerance=1e-3, precision="float64")
    centre = (shape[0] - 1) / 2, (shape[1] - 1) / 2 + 1e-7  # too little to change a picture, but it prevents folding
    folded, unfolded = (
        simulate(SpectralImage(np.ones((1, *shape)), 550.0, pitch_um=16.0, centre_px=where), lens, options)
        for where in (None, centre))
    middle = (0, *(slice(n // 2 - 12, n // 2 + 13) for n in shape))
    np.testing.assert_allclose(folded.cube[middle], unfolded.cube[middle], rtol=1e-5)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
def test_slowly_changing_light_is_flat_within_the_tolerance_or_filtered(tolerance):
    """A gradient that is uniform for one tolerance and not for another."""
    lens = leaning_lens()
    x = np.linspace(0, 1, 220)
    for steepness in (0.03, 0.3, 3.0):
        plane = np.exp(steepness * x)[None, :] * np.ones((200, 1))
        image = SpectralImage(plane[None], 550.0, pitch_um=16.0, centre_px=(300.0, 20.0))
        filtered = simulate(image, lens, Options(section_size=32)).cube
        flat = simulate(image, lens, Options(section_size=32, flat_tolerance=tolerance)).cube
        assert distance_of_light(flat, filtered) <= tolerance


@pytest.fixture
def spread(monkeypatch):
    """The sections that are spread, in order."""
    places = []
    original = PolarSections.spread

    def counted(self, i, columns, *rest):
        places.extend((int(i), int(j)) for j in columns)
        return original(self, i, columns, *rest)

    monkeypatch.setattr(PolarSections, "spread", counted)
    return places


def test_flat_sections_are_not_filtered(spread):
    lens = leaning_lens()
    image = SpectralImage(np.ones((1, 224, 256)), 550.0, pitch_um=16.0, centre_px=(300.0, 20.0))
    simulate(image, lens, Options(section_size=32))
    assert sorted(spread) == [(i, j) for i in range(7) for j in range(8)]
    spread.clear()
    simulate(image, lens, Options(section_size=32, flat_tolerance=1e-3))
    # All but the border is flat, and the rim of the flat area reaches into the border.
    assert sorted(spread) == [(i, j) for i in range(7) for j in range(8) if not (2 <= i < 5 and 2 <= j < 6)]


def test_black_sections_are_not_filtered(spread):
    image = SpectralImage(np.zeros((1, 224, 256)), 550.0, pitch_um=16.0, centre_px=(300.0, 20.0))
    image.cube[0, 40, 70] = 1
    simulate(image, make_lens(gaussian_psf(8, 8, 8.0, 13), psf_pitch_um=8.0), Options(section_size=32))
    assert spread == [(1, 2)]


def test_the_papers_lens_shows_a_grey_wall_like_the_exact_operator():
    """A lens whose PSFs really vary, at 1.8 to 2.4 mm from its axis."""
    lens = load_lens("edmund-54852")
    image = SpectralImage(np.ones((1, 48, 56)), 587.6, pitch_um=12.5, centre_px=(-100.0, 140.0))
    exact, filtered, flat = (simulate(image, lens, options).cube for options in (
        Options(method="exact"), Options(section_size=8), Options(section_size=8, flat_tolerance=1e-3)))
    assert (flat != filtered).any()
    assert distance_of_light(flat, exact) <= distance_of_light(filtered, exact) + 1e-3


@pytest.mark.parametrize("lens, pitch_um", [(comatic_lens(), 25.0), (comatic_lens(), 8.0), (lopsided_lens(), 16.0)],
                         ids=["within a pixel", "over pixels", "off the meridional plane"])
def test_even_light_matches_the_exact_operator_however_psfs_lean(lens, pitch_um):
    """PSFs that lean by less than their pixel remove almost no light from it."""
    image = SpectralImage(np.ones((1, 56, 64)), 550.0, pitch_um=pitch_um, centre_px=(-20.0, -10.0))
    exact, filtered, flat = (simulate(image, lens, options).cube for options in (
        Options(method="exact"), Options(section_size=8), Options(section_size=8, flat_tolerance=1e-3)))
    assert (flat != filtered).any()
    assert distance_of_light(flat, exact) <= distance_of_light(filtered, exact) + 1e-3


@pytest.mark.parametrize("accuracy", [1e-2, 1e-3, 1e-4])
def test_the_accuracy_holds_for_even_light(accuracy):
    lens = lopsided_lens()
    image = SpectralImage(np.ones((1, 80, 80)), 550.0, pitch_um=16.0, centre_px=(-20.0, -10.0))
    exact = simulate(image, lens, Options(method="exact")).cube
    assert distance_of_light(simulate(image, lens, Options(accuracy=accuracy)).cube, exact) <= accuracy
