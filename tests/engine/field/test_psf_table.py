"""PSFs from a table over height and azimuth: its contents, rotation and interpolation."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import comatic_lens, gaussian_psf, lopsided_lens, make_lens, marked_psf
from lensfield.engine import load_lens
from lensfield.engine.field.mirror_symmetry import Planes
from lensfield.engine.field.radial.psf_bank import PsfBank
from lensfield.engine.field.radial.psf_table import PsfTable, PsfTables
from lensfield.engine.image.pixel_grid import PixelGrid

PITCH_UM = 8.0
LENSES = {"comatic": comatic_lens(), "lopsided": lopsided_lens(), "edmund": load_lens("edmund-54852")}
EVERY_LENS = pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES.keys())


def planes(quadrant):
    return Planes(PixelGrid((8, 8), PITCH_UM), quadrant)


def table(lens, azimuths=4, quadrant=False, nm=550.0, energy=1.0, precision="float64", wavelengths_nm=None):
    radius_px = max(bank(lens, each, energy).radius_px for each in lens.wavelengths_nm)
    tables = PsfTables(lens, wavelengths_nm or (nm,), planes(quadrant), lambda bank: bank.trimmed(energy, radius_px),
                       azimuths, precision)
    return PsfTable(tables.at_wavelength(nm))


def bank(lens, nm=550.0, energy=1.0):
    return PsfBank.of(lens.at_wavelength(nm), PITCH_UM).trimmed(energy)


def node_places(lens, azimuths, quadrant):
    """All nodes of a table: heights and azimuths, clockwise from the right."""
    steps = np.arange(2 * azimuths * (1 if quadrant else 4) + (1 if quadrant else 0))
    height, azimuth = np.meshgrid(lens.heights_mm, -np.pi / 4 / azimuths * steps, indexing="ij")
    return height.ravel(), azimuth.ravel()


@EVERY_LENS
@pytest.mark.parametrize("azimuths", [1, 3, 8])
@pytest.mark.parametrize("quadrant", [False, True])
def test_a_table_is_exact_at_its_nodes(lens, azimuths, quadrant):
    places = node_places(lens, azimuths, quadrant)
    np.testing.assert_allclose(table(lens, azimuths, quadrant).psfs(*places), bank(lens).psfs(*places), atol=1e-13)


@EVERY_LENS
def test_the_table_of_one_quadrant_is_a_quarter(lens):
    assert table(lens, 4, True).table.shape[:2] == (lens.heights_mm.size, 9)
    assert table(lens, 4, False).table.shape[:2] == (lens.heights_mm.size, 33)


@EVERY_LENS
def test_a_quadrants_table_agrees_with_the_full_table(lens):
    rng = np.random.default_rng(0)
    height, azimuth = rng.uniform(0, 2.5, 50), -rng.uniform(0, np.pi / 2, 50)
    quarter, full = (table(lens, 3, quadrant).psfs(height, azimuth) for quadrant in (True, False))
    np.testing.assert_allclose(quarter, full, atol=1e-13)


@EVERY_LENS
@pytest.mark.parametrize("azimuth", [0.0, 0.1, -0.7, 1.2, 3.0])
def test_a_quarter_turn_rotates_the_pixels_and_a_full_turn_changes_nothing(lens, azimuth):
    full_table = table(lens, 4)
    heights = np.linspace(0, 2.2, 7)
    first, quarter, full, back = (full_table.psfs(heights, np.full(7, azimuth + turn)) for turn in
                                  (0, np.pi / 2, 2 * np.pi, -2 * np.pi))
    np.testing.assert_allclose(quarter, np.rot90(first, axes=(1, 2)), atol=1e-13)
    np.testing.assert_allclose(full, first, atol=1e-13)
    np.testing.assert_allclose(back, first, atol=1e-13)


def test_the_edges_of_a_quadrant_are_in_its_table():
    """Pixels on the axes, with azimuths as arctan2 returns them, including signed zeros."""
    lens = LENSES["comatic"]
    x, y = np.array([1.0, 1.0, 0.0, 0.0, 0.0]), np.array([0.0, -0.0, -1.0, 0.0, -0.0])
    places = np.full(5, 1.3), np.arctan2(y, x)
    np.testing.assert_allclose(table(lens, 3, True).psfs(*places), bank(lens).psfs(*places), atol=1e-13)


@EVERY_LENS
def test_the_psf_halfway_between_azimuths_is_their_mean(lens):
    polar, step = table(lens, 4), np.pi / 16
    heights = lens.heights_mm
    halfway, before, after = (polar.psfs(heights, np.full(heights.size, azimuth)) for azimuth in
                              (-2.5 * step, -2 * step, -3 * step))
    np.testing.assert_allclose(halfway, (before + after) / 2, atol=1e-14)


@EVERY_LENS
def test_psfs_between_heights_are_interpolated_as_in_the_bank(lens):
    heights = np.random.default_rng(1).uniform(0, 2 * lens.heights_mm[-1], 30)  # constant beyond the last height
    places = heights, np.full(30, -np.pi / 4)
    np.testing.assert_allclose(table(lens, 1).psfs(*places), bank(lens).psfs(*places), atol=1e-13)


@EVERY_LENS
@pytest.mark.parametrize("quadrant", [False, True])
def test_every_psf_sums_to_one_and_none_is_negative(lens, quadrant):
    rng = np.random.default_rng(2)
    psfs = table(lens, 3, quadrant).psfs(rng.uniform(0, 3, 200), -rng.uniform(0, np.pi / 2, 200))
    np.testing.assert_allclose(psfs.sum(axis=(1, 2)), 1, atol=1e-13)
    assert psfs.min() >= 0


@EVERY_LENS
def test_the_error_between_azimuths_falls_with_their_number(lens):
    rng = np.random.default_rng(3)
    places = rng.uniform(0, 2, 60), rng.uniform(-np.pi, np.pi, 60)
    truth = bank(lens).psfs(*places)
    errors = [np.abs(table(lens, azimuths).psfs(*places) - truth).sum(axis=(1, 2)).max() for azimuths in (2, 8, 32)]
    assert errors[0] > 2 * errors[1] > 4 * errors[2]


def test_taps_are_limited_to_those_that_a_psf_reaches():
    lens = make_lens(gaussian_psf(3, 3, 1.0, 5), psf_pitch_um=1.0)  # smaller than a pixel of 8 um
    polar = table(lens, 2)
    reached = bank(lens).psfs(*node_places(lens, 2, False)).any(axis=0)
    assert {(int(row), int(column)) for row, column in zip(polar.rows, polar.columns, strict=True)} == {
        tuple(place) for place in np.argwhere(reached).tolist()}


def test_psfs_do_not_depend_on_the_batch_size():
    polar = table(LENSES["comatic"], 4)
    rng = np.random.default_rng(4)
    places = rng.uniform(0, 2, 20_000), rng.uniform(-np.pi, np.pi, 20_000)
    together = polar.psfs(*places)
    for start, stop in ((0, 1), (7000, 7100), (19_999, 20_000)):
        part = polar.psfs(places[0][start:stop], places[1][start:stop])
        np.testing.assert_array_equal(part, together[start:stop])


@pytest.mark.parametrize("lowest_mm, highest_mm, fewer",
                         [(0, 0, True), (0.1, 0.3, True), (1.7, 5, False), (0, 5, False)])
def test_taps_beyond_the_psfs_at_these_heights_are_omitted(lowest_mm, highest_mm, fewer):
    polar = table(LENSES["comatic"], 4, energy=0.99)  # widens with the field
    rng = np.random.default_rng(5)
    places = rng.uniform(lowest_mm, highest_mm, 50), rng.uniform(-np.pi, np.pi, 50)
    rows, columns, psfs = polar.mixed(places)
    assert (rows.size < 0.6 * polar.rows.size) == fewer
    full = sum(weight[:, None, None] * polar.node_psfs(node)
               for node, weight in zip(*polar.corners(places), strict=True))
    np.testing.assert_array_equal(full[:, rows, columns], psfs.T)
    full[:, rows, columns] = 0
    assert not full.any()


MANY_NM = tuple(np.linspace(400, 700, 9))


@pytest.mark.parametrize("nm", MANY_NM)
def test_mixed_tables_equal_the_table_of_the_mixed_lens(nm):
    """Nine wavelengths of a lens with two: the tables of the two serve all nine."""
    sharp, soft = (np.tile(gaussian_psf(s, 0.7 * s, 2.5, 25), (11, 1, 1)) for s in (4, 8))
    lens = make_lens(np.stack([sharp, soft]))
    weight = (nm - 400) / 300
    mixed = replace(lens, psf=np.stack([(1 - weight) * sharp + weight * soft] * 2))
    np.testing.assert_allclose(
        table(lens, 3, nm=nm, wavelengths_nm=MANY_NM).psfs(*node_places(lens, 3, False)),
        table(mixed, 3).psfs(*node_places(lens, 3, False)), atol=1e-8)  # the PSFs of the lens are float32


@pytest.mark.parametrize("wavelengths_nm, expected", [(MANY_NM, 2), ((400.0, 700.0), 2), ((450.0,), 1),
                                                      ((400.0, 450.0, 500.0), 2)])
def test_as_few_tables_as_possible_are_computed(wavelengths_nm, expected, monkeypatch):
    banks = []
    original = PsfBank.of

    def counted(*args):
        banks.append(args)
        return original(*args)

    monkeypatch.setattr(PsfBank, "of", counted)
    tables = PsfTables(make_lens(), wavelengths_nm, planes(False), lambda bank: bank, 2, "float64")
    for nm in wavelengths_nm:
        tables.at_wavelength(nm)
    assert len(banks) == expected


def test_symmetric_and_asymmetric_wavelengths_can_be_mixed():
    """The table for one wavelength covers 45 degrees, and that for the other 90."""
    even, lean = (np.tile(psf, (11, 1, 1)) for psf in (gaussian_psf(4, 3, 2.5, 25), marked_psf(3, 5)))
    lens = make_lens(np.stack([even, lean]))
    places = node_places(lens, 3, False)
    parts = [table(replace(lens, psf=np.stack([psf, psf])), 3, nm=400.0).psfs(*places) for psf in (even, lean)]
    mixed = table(lens, 3, nm=475.0, wavelengths_nm=MANY_NM).psfs(*places)
    np.testing.assert_allclose(mixed, 0.75 * parts[0] + 0.25 * parts[1], atol=1e-8)


def test_a_trimmed_table_equals_the_trimmed_bank():
    lens = LENSES["comatic"]
    places = node_places(lens, 2, False)
    trimmed = bank(lens, energy=0.95)
    assert trimmed.radius_px < bank(lens).radius_px
    np.testing.assert_allclose(table(lens, 2, energy=0.95).psfs(*places), trimmed.psfs(*places), atol=1e-13)


def test_single_precision_is_accurate_to_its_last_digits():
    lens = LENSES["comatic"]
    places = np.linspace(0, 2, 40), np.linspace(-3, 3, 40)
    single = table(lens, 3, precision="float32").psfs(*places)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, table(lens, 3).psfs(*places), atol=2e-7)


def test_tables_do_not_depend_on_the_number_of_threads(monkeypatch):
    tables = []
    for threads in (1, 2, 5):
        monkeypatch.setattr("lensfield.engine.runtime.threads.thread_count", lambda threads=threads: threads)
        tables.append(table(LENSES["comatic"], 4).table)
    np.testing.assert_array_equal(tables[0], tables[1])
    np.testing.assert_array_equal(tables[0], tables[2])


@pytest.mark.parametrize("v, u", [(0, 0), (8, 0), (-3, 0), (6, 8), (0, 15)])
def test_mean_distance_is_that_of_the_light_from_its_chief_ray(v, u):
    lens = make_lens(marked_psf(v, u, 33), psf_pitch_um=PITCH_UM / 2)
    assert table(lens).mean_distance_px == pytest.approx(np.hypot(v, u) / 2, abs=0.5)  # the distance of a pixel
