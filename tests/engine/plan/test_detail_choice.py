"""Whether light that is known inside pixels is blurred in finer ones: by options, and by the work that it takes."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import gaussian_psf, make_lens
from lensfield.engine import Options, Report, SpectralImage, load_lens, simulate
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.sampling import Sampling
from lensfield.engine.plan import cost
from lensfield.engine.plan.choose import LITTLE_NS, make_plan, workload
from lensfield.engine.rays.rings import Rings

NM = (450.0, 550.0, 650.0)
SHARP, SOFT = (make_lens(gaussian_psf(sigma_um, sigma_um, pitch_um, 121), psf_pitch_um=pitch_um)
               for sigma_um, pitch_um in ((2.0, 0.25), (40.0, 4.0)))
PIXELS = Options(method="pixels")
LARGE = Sampling(PixelGrid((900, 1400), 4.0, (333.3, 612.8), (40, 50)), NM)


@pytest.mark.parametrize("lens, options, known", [
    (SHARP, Options(), 2), (SHARP, Options(detail="off"), 1), (SHARP, Options(method="paper"), 1),
    (SHARP, Options(section_size=8), 1), (SHARP, Options(section_size=8, detail="on"), 2),
    (SHARP, Options(accuracy=0.1, method="pixels"), 2),
    (SOFT, Options(method="pixels"), 1), (SOFT, Options(method="pixels", detail="on"), 2),
    (SOFT, Options(method="pixels", supersampling=2), 2)])
def test_detail_is_used_where_it_takes_little_or_on_request(lens, options, known):
    plan = make_plan(options, lens, LARGE, 2)
    assert plan.known == known and plan.supersampling == max(known, options.supersampling)
    assert ("with detail" in plan.text) == (known > 1)
    assert replace(make_plan(options, lens, LARGE), known=1) == replace(plan, known=1) or known > 1


def test_the_choice_follows_work_that_is_the_same_on_every_machine(monkeypatch):
    known = []
    for lens in (SHARP, SOFT):
        even = make_plan(PIXELS, lens, LARGE)
        work_ns = cost.nanoseconds(workload(even, lens, LARGE), even) / np.prod(LARGE.grid.shape_px)
        monkeypatch.setattr(cost, "machine_factor", lambda: 1e6)
        known.append(make_plan(PIXELS, lens, LARGE, 2).known)
        assert known[-1] == (2 if work_ns <= LITTLE_NS else 1)
    assert known == [2, 1]


def test_detail_takes_at_most_sixteen_times_the_work():
    """The reason for the limit: four times the parts, with four times the pixels in their PSFs."""
    for sigma_um in (2.0, 6.0, 12.0):
        lens = make_lens(gaussian_psf(sigma_um, sigma_um, sigma_um / 8, 121), psf_pitch_um=sigma_um / 8)
        even, detailed = (make_plan(Options(detail="on"), lens, LARGE, known) for known in (1, 2))
        works = [cost.nanoseconds(workload(plan, lens, LARGE), plan) for plan in (even, detailed)]
        assert works[1] < 16 * works[0]


def test_small_pictures_have_detail():
    """The work of a wavelength, whatever its size, does not count for them."""
    small = replace(LARGE, grid=PixelGrid((30, 44), 4.0, (11.1, 25.3), (4, 5)))
    assert make_plan(Options(), SHARP, small, 2).known == 2


def test_pixels_stay_whole_if_the_plan_leaves_detail_out():
    rng = np.random.default_rng(4)
    fine = SpectralImage(rng.random((3, 60, 88)), NM, PixelGrid((60, 88), 2.0, (20.0, 51.0), (12, 16)))
    known = fine.coarser(2)
    for options in (Options(section_size=8), Options(detail="off"), Options(detail="off", supersampling=2)):
        report = Report()
        np.testing.assert_array_equal(simulate(known, SHARP, options, report=report).cube,
                                      simulate(known.even(), SHARP, options).cube)
        assert report.lens_image.softening_px > 0.4


@pytest.mark.parametrize("f_number, columns", [(4.0, 768), (None, 1920)])
def test_modern_lenses_have_detail_by_default(f_number, columns):
    lens = load_lens("sigma-40mm-f1.4", Rings(f_number=f_number), "preview")
    grid = PixelGrid((columns * 2 // 3, columns), 36e3 / columns)
    assert make_plan(Options(), lens, Sampling(grid, NM), 2).known == 2
