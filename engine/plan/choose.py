"""make_plan(): from options to a plan. A requested accuracy is met with the least predicted work."""

import math
import time
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property

import numpy as np

from ..blur import METHODS, Method, OnePsf, Paper
from ..blur.method import Workload
from ..field.field_map import field_map
from ..field.mirror_symmetry import Planes
from ..image.sampling import Sampling
from ..lens.lens import Lens
from ..runtime.errors import ImageError, InputError
from ..runtime.scratch import SAMPLE_BYTES
from . import cost
from .options import AUTO, BY_KNOBS, DEFAULT_ACCURACY, OFF, ON, Options
from .plan import Plan

SINGLE_RANGE = 1e3  # the dimmest pixel stays accurate to about 1e-4
PSF_ENERGY = 1 - 1e-6
FLAT_SHARE, ROUNDING_SHARE = 1 / 16, 1 / 50  # of the accuracy
FLAT_OF_ERROR = 1 / 8  # of the error of the PSFs, at most, for the tolerance of flat sections
SINGLE_ROUNDING = 6e-7  # of sums in single precision
TRIM_SHARES = 5 / 8, 3 / 4, 7 / 8  # of the remaining error, for trimming PSFs; the rest is for the table
WITHOUT_STEPS_SHARE = 63 / 64  # with a table that has no error: all except rounding
LESSER_TRIM_SHARES = 3 / 8, 1 / 8  # if no table is fine enough with the shares above
HALO_SHARE = 1 / 16  # for trimming the PSFs of highlights, whose trimmed light would be visible
ONE_PSF_TRIM_SHARE = 1 / 8  # of one PSF for the picture, whose width hardly affects the cost of its transform
SINGLE_ACCURACY = 3e-5  # the smallest that single precision can meet
SINGLE_NOISE = 1.2e-7  # rounding error relative to the light, per unit of dynamic range
STEP_CHOICES = tuple(sorted({round(2 ** (k / 2)) for k in range(2, 21)}))
GUESS_STEPS, GUESS_POWER = 8, 2  # errors decrease with approximately this power of the steps
DETAIL_PARTS = 2  # of a pixel, down and across, in which light with a detail is blurred
LITTLE_NS, LEAST_PX = 150, 2**18  # work for a pixel at a wavelength that detail may multiply, by up to 16; and pixels
# of a picture that always takes little


def make_plan(options: Options, lens: Lens, sampling: Sampling, known: int = 1) -> Plan:
    """The plan for filtering pictures of this sampling: by its knobs, or by the requested accuracy.

    The plan's seconds include the time to choose it.

    Parameters
    ----------
    options : Options
    lens : Lens
    sampling : Sampling
    known : int
        Parts of a pixel, down and across, whose light is known: 1 without a detail.

    Raises
    ------
    ImageError
        If the pixel pitch is so small that the PSFs have too many pixels.
    InputError
        If supersampling makes the pitch that small.
    LensError
        If a wavelength is outside the lens data, or the distortion folds the field.
    """
    begin = time.perf_counter()
    plan = priced(_plan(options, lens, sampling, known), lens, sampling)
    return replace(plan, seconds=plan.seconds + time.perf_counter() - begin)


def _plan(options, lens, sampling, known):
    """The plan, with or without detail, without its price."""
    if known == 1 or options.detail != ON:
        even = _plan_in_parts(options, lens, sampling)
        if known == 1 or options.detail == OFF or not _takes_little(even, options, lens, sampling):
            return even
    finer = replace(options, supersampling=max(options.supersampling, min(known, DETAIL_PARTS)))
    return replace(_plan_in_parts(finer, lens, sampling), known=known)


def _takes_little(plan, options, lens, sampling):
    """Whether the plan for pixels with even light leaves room for detail: the same on every machine."""
    if not options.by_result:
        return False
    most_ns = LITTLE_NS * max(math.prod(sampling.grid.shape_px), LEAST_PX)
    return options.supersampling > 1 or cost.nanoseconds(workload(plan, lens, sampling), plan) <= most_ns


def _plan_in_parts(options, lens, sampling):
    """The plan in pixels that are divided by supersampling, without its price."""
    times = options.supersampling
    finer = sampling.finer(times)
    try:
        plan = _Planner(options, lens, finer).best() if options.by_result else _knob_plan(options, lens, finer)
    except ImageError as error:
        raise InputError("options", "supersampling", times, error.remedy) if times > 1 else error from None
    return replace(plan, supersampling=times)


def _knob_plan(options, lens, sampling):
    """The plan by knobs, with defaults for those that are not set.

    A section larger than the picture is reduced to the picture's size. The computational space always holds a section
    and the PSFs that extend beyond it, to avoid wraparound.
    """
    way = METHODS[BY_KNOBS if options.method == AUTO else options.method]
    energy = options.psf_energy or (1.0 if way.yardstick else PSF_ENERGY)
    precision = options.precision or ("float64" if way.yardstick else AUTO)
    field = field_map(lens)
    if not field.rotationally_symmetric:
        _check_knobs(options, lens)
    radius_px, taps = field.picture_psfs(sampling, energy).reach(energy)
    single_range = {AUTO: SINGLE_RANGE, "float32": np.inf, "float64": 0.0}[precision]
    most_px = max(sampling.grid.frame_px) + 2 * radius_px
    method = way.by_knobs(options.section_size, options.azimuths, radius_px, most_px)
    if method.tabulated and not field.rotationally_symmetric:
        method = replace(method, azimuths=0)
    return Plan(
        method=method,
        psf_radius_px=radius_px, psf_energy=energy, taps=taps,
        precision="float64" if precision == "float64" else "float32",
        single_range=single_range if way.transforms or not single_range else np.inf,
        flat_tolerance=options.flat_tolerance or 0.0,
        folded=not way.yardstick and sampling.grid.centred and field.mirror_symmetric,
        out_of_field=options.out_of_field)


def _check_knobs(options, lens):
    """Raise an InputError for knobs of rotationally symmetric lenses."""
    if options.method == Paper.name:
        raise InputError("options", "method", options.method,
                         f"{lens.name} is not rotationally symmetric: choose another method")
    if options.azimuths is not None:
        raise InputError("options", "azimuths", options.azimuths,
                         f"leave it out: {lens.name} is not rotationally symmetric")


def workload(plan: Plan, lens: Lens, sampling: Sampling) -> Workload:
    """The figures, in addition to the plan, that its cost depends on."""
    grid, field = sampling.grid.finer(plan.supersampling), field_map(lens)
    layout = field.layout(grid.pitch_um)
    reach_um = min(layout.window_um, 2 * plan.psf_radius_px * grid.pitch_um)
    return Workload(
        plan.planes(grid), plan.psf_radius_px, plan.taps, layout,
        samples=np.pi / 4 * (reach_um / layout.sample_um) ** 2,
        window_samples=(layout.window_um / layout.sample_um) ** 2,
        tables=len(field.table_wavelengths(sampling)) / len(sampling.wavelengths_nm))


def priced(plan: Plan, lens: Lens, sampling: Sampling) -> Plan:
    """A plan with its predicted seconds and memory for pictures of this sampling, on this machine."""
    work = workload(plan, lens, sampling)
    split = SAMPLE_BYTES * math.prod(sampling.finer(plan.supersampling).grid.shape_px) if plan.supersampling > 1 else 0
    return replace(plan, seconds=cost.seconds(work, plan) * len(sampling.wavelengths_nm),
                   memory_mb=cost.memory_mb(work, plan) + split / cost.MEGABYTE)


class _Planner:
    """Finds the plan with the least predicted work that meets an accuracy.

    A point's misplaced light is at most the sum of four parts: twice the trimmed energy, because the rest is
    normalised; the error of mixing PSFs from a table; the tolerance of flat sections; and rounding. This sum is the
    bound. Trimming more leaves fewer pixels to spread light to, but requires a table with more steps; the cheapest
    combination is chosen.
    """

    def __init__(self, options, lens, sampling):
        self._accuracy = DEFAULT_ACCURACY if options.accuracy is None else options.accuracy
        self._precision = "float32" if self._accuracy >= SINGLE_ACCURACY else "float64"
        self._flat, self._rounding = self._accuracy * FLAT_SHARE, self._accuracy * ROUNDING_SHARE
        self._enough = self._accuracy - self._flat - self._rounding
        self._options, self._lens, self._sampling = options, lens, sampling
        self._psfs = field_map(lens).picture_psfs(sampling, self._energy(HALO_SHARE))
        self._folded = sampling.grid.centred and field_map(lens).mirror_symmetric
        self._in_steps = field_map(lens).rotationally_symmetric

    def best(self) -> Plan:
        """The plan, with its errors; with the exact operator if no other method is accurate enough."""
        return replace(self._best(), uniform_light_error=self._psfs.uniform_light_error())

    def _best(self):
        method = self._options.method
        if method == AUTO:
            error = self._isoplanatic_error()
            if error <= self._enough:
                return self._cheapest([OnePsf], ONE_PSF_TRIM_SHARE, 0, error)
        ways = [way for way in METHODS.values() if way.by_accuracy and method in (AUTO, way.name)]
        if not self._in_steps:
            error = self._psfs.mixing_error(list(self._mixing_errors(WITHOUT_STEPS_SHARE)), 0)
            return self._cheapest(ways, WITHOUT_STEPS_SHARE, 0, error)
        too_much = 1.0
        for share in self._shares(ways):
            steps, error = self._steps(share) if share < too_much else (0, 0.0)
            if steps:
                return self._cheapest(ways, share, steps, error)
            too_much = min(share, too_much)
        plan = _knob_plan(replace(self._options, accuracy=None, method="exact"), self._lens, self._sampling)
        return replace(plan, error_bound=0.0)

    def _energy(self, share):
        """The energy of PSFs after trimming that takes this share of the error."""
        return 1 - share * self._enough / 2

    def _planes(self, widest):
        """The planes of a plan whose widest PSFs are trimmed by this share of the error."""
        radius_px, _ = self._psfs.reach(self._energy(widest))
        return Planes(self._sampling.grid.within_reach(radius_px), self._folded)

    def _mixing_errors(self, share):
        return self._psfs.mixing(self._energy(share), self._planes(HALO_SHARE))

    def _shares(self, ways):
        """Possible shares of the error for trimming, sorted by cost with an estimated number of steps."""
        def nanoseconds(share):
            return self._least_work(ways, share, max(2, round(self._guess(share))))[0]

        return *sorted(TRIM_SHARES, key=nanoseconds), *LESSER_TRIM_SHARES

    def _guess(self, share):
        """Estimated number of steps that the table requires if trimming takes this share."""
        return GUESS_STEPS * (self._mixing / self._left(share)) ** (1 / GUESS_POWER)

    @cached_property
    def _mixing(self):
        """The error of mixing PSFs from a table of GUESS_STEPS steps, at one wavelength."""
        share = TRIM_SHARES[len(TRIM_SHARES) // 2]
        error = self._psfs.mixing_estimate(next(self._mixing_errors(share)), GUESS_STEPS)
        return max(error - share * self._enough, 0)

    def _left(self, share):
        """The error that remains for mixing."""
        return (1 - share) * self._enough

    def _cheapest(self, ways: Iterable[type[Method]], share: float, steps: int, error: float) -> Plan:
        """The plan with the least predicted work by one of these methods, with this error of its PSFs."""
        _, plan = self._least_work(ways, share, steps)
        flat = min(plan.flat_tolerance, FLAT_OF_ERROR * error)
        rounding = self._rounding if plan.method.transforms else min(self._rounding, SINGLE_ROUNDING)
        return replace(plan, flat_tolerance=flat, error_bound=flat + rounding + error)

    def _least_work(self, ways, share, steps):
        """The least predicted work by one of these methods, in nanoseconds, and its plan."""
        radius_px, taps = self._psfs.reach(self._energy(share))
        widest = HALO_SHARE if any(way.tabulated for way in ways) else share  # one PSF is without halos
        most_px = max(self._planes(widest).grid.shape_px)
        plans = [self._plan(method, share, radius_px, taps)
                 for way in ways for method in way.choices(steps, radius_px, most_px)]
        work = workload(plans[0], self._lens, self._sampling)  # the same for all
        nanoseconds = [cost.nanoseconds(work, plan) for plan in plans]
        least = int(np.argmin(nanoseconds))
        return nanoseconds[least], plans[least]

    def _plan(self, method, share, radius_px, taps):
        """A plan by one of the methods. Without a table, no section counts as flat."""
        single_range = np.inf
        if self._precision == "float64":
            single_range = 0.0
        elif method.transforms:
            single_range = self._rounding / (SINGLE_NOISE * (method.space_px / method.section_size) ** 2)
        halo_energy = self._energy(HALO_SHARE) if method.tabulated else None
        return Plan(method=method, psf_radius_px=radius_px, psf_energy=self._energy(share), taps=taps,
                    halo_energy=halo_energy, halo_radius_px=self._psfs.reach(halo_energy)[0] if halo_energy else 0,
                    precision=self._precision, single_range=single_range,
                    flat_tolerance=self._flat if method.tabulated else 0.0, folded=self._folded,
                    out_of_field=self._options.out_of_field)

    def _isoplanatic_error(self):
        """The error of using the middle PSF of the planes for the complete field, or some error above the limit."""
        return self._psfs.one_psf_error(self._energy(ONE_PSF_TRIM_SHARE), self._planes(ONE_PSF_TRIM_SHARE),
                                        self._enough)

    def _steps(self, share):
        """The smallest sufficient number of steps, and the error including trimming; 0 if no number is sufficient."""
        wavelengths = list(self._mixing_errors(share))
        wanted = 0.9 * self._guess(share)
        while wanted <= STEP_CHOICES[-1]:
            steps = STEP_CHOICES[int(np.searchsorted(STEP_CHOICES, wanted))]
            error = self._psfs.mixing_error(wavelengths[:1], steps)
            if error <= self._enough and wavelengths[1:]:  # their errors are usually smaller
                error = max(error, self._psfs.mixing_error(wavelengths[1:], steps))
            if error <= self._enough:
                return steps, error
            mixing = (error - share * self._enough) / self._left(share)
            wanted = max(steps + 1, steps * np.sqrt(mixing))  # errors decrease at most with the second power
        return 0, 0.0
