"""make_plan(): from what is asked to how it is done. An accuracy is met at the least predicted work."""

import time
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..blur import METHODS, Method, OnePsf
from ..blur.method import Workload
from ..errors import ImageError, InputError
from ..field.mirror_symmetry import Planes
from ..field.psf_bank import refinement
from ..image.spectral_image import SpectralImage
from . import cost
from .error_bound import AzimuthErrors, azimuth_error, isoplanatic_error
from .options import AUTO, BY_KNOBS, DEFAULT_ACCURACY, Options
from .picture_psfs import PicturePsfs, telling_wavelengths
from .plan import Plan

if TYPE_CHECKING:
    from ..lens.lens import Lens

SINGLE_RANGE = 1e3  # leaves the dimmest pixel right to some 1e-4
PSF_ENERGY = 1 - 1e-6
FLAT_SHARE, ROUNDING_SHARE = 1 / 16, 1 / 50  # of the accuracy
TRIM_SHARES = 5 / 8, 3 / 4, 7 / 8  # of what is left: what trimming PSFs may misplace; the rest is the azimuths'
LESSER_TRIM_SHARES = 3 / 8, 1 / 8  # where no azimuths are enough beside these
HALO_SHARE = 1 / 16  # what trimming may misplace of light so bright that it would show
ONE_PSF_TRIM_SHARE = 1 / 8  # of one PSF for the picture, whose transform costs little more if it is wide
SINGLE_ACCURACY = 3e-5  # the least that single precision is good for
SINGLE_NOISE = 1.2e-7  # of the light, per unit of dynamic range
AZIMUTH_CHOICES = tuple(sorted({round(2 ** (k / 2)) for k in range(2, 21)}))
GUESS_AZIMUTHS, GUESS_POWER = 8, 1.6  # errors fall about with this power
ISOPLANATIC_SAMPLES = 4  # azimuths to look at


def make_plan(options: Options, lens: "Lens", radiance: SpectralImage) -> Plan:
    """The plan for filtering a radiance picture: by its knobs, or by the accuracy asked for.

    What it took to make it is part of its seconds.

    Raises
    ------
    ImageError
        A pixel pitch so small that the PSFs come out larger than anybody wants.
    InputError
        The same, by supersampling.
    LensError
        A wavelength outside the lens data; a distortion that folds the field.
    """
    begin, times = time.perf_counter(), options.supersampling
    finer = _in_finer_pixels(radiance, times)
    try:
        plan = _Planner(options, lens, finer).best() if options.by_result else _knob_plan(options, lens, finer)
    except ImageError as error:
        raise InputError("options", "supersampling", times, error.remedy) if times > 1 else error from None
    plan = priced(replace(plan, supersampling=times), lens, radiance)
    return replace(plan, seconds=plan.seconds + time.perf_counter() - begin)


def _in_finer_pixels(radiance, times):
    """What a plan depends on of a picture: all but its light."""
    grid = radiance.grid.finer(times)
    dark = np.broadcast_to(np.float32(0), (radiance.wavelengths_nm.size, *grid.shape_px))
    return SpectralImage(dark, radiance.wavelengths_nm, grid)


def _knob_plan(options, lens, radiance):
    """The plan that the knobs come to, what is not set being the default.

    A section larger than the picture is cut down to it; the computational space always holds a section and the
    PSFs that reach out of it, so that nothing wraps around.
    """
    way = METHODS[BY_KNOBS if options.method == AUTO else options.method]
    energy = options.psf_energy or (1.0 if way.yardstick else PSF_ENERGY)
    precision = options.precision or ("float64" if way.yardstick else AUTO)
    radius_px, taps = PicturePsfs(lens, radiance, energy).reach(energy)
    single_range = {AUTO: SINGLE_RANGE, "float32": np.inf, "float64": 0.0}[precision]
    most_px = max(radiance.frame_px) + 2 * radius_px
    return Plan(
        method=way.by_knobs(options.section_size, options.azimuths, radius_px, most_px),
        psf_radius_px=radius_px, psf_energy=energy, taps=taps,
        precision="float64" if precision == "float64" else "float32",
        single_range=single_range if way.transforms or not single_range else np.inf,
        flat_tolerance=options.flat_tolerance or 0.0,
        folded=not way.yardstick and radiance.grid.centred and lens.mirror_symmetric,
        out_of_field=options.out_of_field)


def workload(plan: Plan, lens: "Lens", radiance: SpectralImage) -> Workload:
    """What the cost of a plan depends on, beside the plan."""
    heights, height_um = lens.heights_mm.size, 1e3 * lens.heights_mm[-1] / lens.heights_mm.size
    grid = radiance.grid.finer(plan.supersampling)
    fine_um = lens.psf_pitch_um / refinement(lens, grid.pitch_um)
    window_um = lens.psf.shape[-1] * lens.psf_pitch_um
    reach_um = min(window_um, 2 * plan.psf_radius_px * grid.pitch_um)
    return Workload(
        plan.planes(grid), plan.psf_radius_px, plan.taps, heights, height_um / grid.pitch_um,
        samples=np.pi / 4 * (reach_um / fine_um) ** 2, window_samples=(window_um / fine_um) ** 2,
        tables=len(telling_wavelengths(lens, radiance)) / radiance.wavelengths_nm.size,
        mirror_symmetric=lens.mirror_symmetric)


def priced(plan: Plan, lens: "Lens", radiance: SpectralImage) -> Plan:
    """A plan with the seconds and the memory that it will take on a picture, on this machine."""
    work = workload(plan, lens, radiance)
    split = radiance.cube[0].nbytes * plan.supersampling**2 if plan.supersampling > 1 else 0
    return replace(plan, seconds=cost.seconds(work, plan) * radiance.wavelengths_nm.size,
                   memory_mb=cost.memory_mb(work, plan) + split / cost.MEGABYTE)


class _Planner:
    """Looks for the plan of least predicted work whose error stays within an accuracy.

    A point's light goes wrong by no more than the sum of: twice the energy trimmed, for the rest is normalised; what
    mixing PSFs from those of a few azimuths comes to; what flat sections may; and rounding. That is the bound. Trimming
    more leaves fewer pixels to spread light to, but asks for more azimuths: what costs least is chosen.
    """

    def __init__(self, options, lens, radiance):
        self._accuracy = DEFAULT_ACCURACY if options.accuracy is None else options.accuracy
        self._precision = "float32" if self._accuracy >= SINGLE_ACCURACY else "float64"
        self._flat, self._rounding = self._accuracy * FLAT_SHARE, self._accuracy * ROUNDING_SHARE
        self._enough = self._accuracy - self._flat - self._rounding
        self._options, self._lens, self._radiance = options, lens, radiance
        self._psfs = PicturePsfs(lens, radiance, self._energy(HALO_SHARE))
        self._folded = radiance.grid.centred and self._psfs.mirror_symmetric

    def best(self) -> Plan:
        """The plan; the exact operator where nothing less is accurate enough."""
        asked = self._options.method
        if asked == AUTO:
            error = self._isoplanatic_error()
            if error <= self._enough:
                return self._cheapest([OnePsf], ONE_PSF_TRIM_SHARE, 0, error)
        ways = [way for way in METHODS.values() if way.by_accuracy and asked in (AUTO, way.name)]
        too_much = 1.0
        for share in self._shares(ways):
            azimuths, error = self._azimuths(share) if share < too_much else (0, 0.0)
            if azimuths:
                return self._cheapest(ways, share, azimuths, error)
            too_much = min(share, too_much)
        plan = _knob_plan(replace(self._options, accuracy=None, method="exact"), self._lens, self._radiance)
        return replace(plan, error_bound=0.0)

    def _energy(self, share):
        """What PSFs keep that are trimmed by this share of the error."""
        return 1 - share * self._enough / 2

    def _planes(self, widest):
        """The planes of a plan whose widest PSFs are trimmed by this share."""
        radius_px, _ = self._psfs.reach(self._energy(widest))
        return Planes(self._radiance.grid.within_reach(radius_px), self._folded)

    def _trimmed(self, share, widest=HALO_SHARE):
        return self._psfs.trimmed(self._energy(share), self._planes(widest))

    def _shares(self, ways):
        """The shares of the error that trimming may have; those first that are cheapest by a guess at the azimuths."""
        def nanoseconds(share):
            return self._least_work(ways, share, max(2, round(self._guess(share))))[0]

        return *sorted(TRIM_SHARES, key=nanoseconds), *LESSER_TRIM_SHARES

    def _guess(self, share):
        """How many azimuths will do, about, beside trimming by this share."""
        return GUESS_AZIMUTHS * (self._mixing / self._left(share)) ** (1 / GUESS_POWER)

    @cached_property
    def _mixing(self):
        """The error of mixing PSFs between a few azimuths, at one wavelength."""
        share = TRIM_SHARES[len(TRIM_SHARES) // 2]
        error = azimuth_error([_errors(next(self._trimmed(share)))], GUESS_AZIMUTHS)
        return max(error - share * self._enough, 0)

    def _left(self, share):
        """The error that trimming leaves to mixing."""
        return (1 - share) * self._enough

    def _cheapest(self, ways: Iterable[type[Method]], share: float, azimuths: int, error: float) -> Plan:
        """The plan of least predicted work by one of these ways, with PSFs that err by this much."""
        _, plan = self._least_work(ways, share, azimuths)
        return replace(plan, error_bound=self._flat + self._rounding + error)

    def _least_work(self, ways, share, azimuths):
        """The least predicted work by one of these ways, in nanoseconds, and the plan."""
        radius_px, taps = self._psfs.reach(self._energy(share))
        widest = HALO_SHARE if azimuths else share  # one PSF for all has no halos
        most_px = max(self._planes(widest).grid.shape_px)
        plans = [self._plan(method, share, radius_px, taps)
                 for way in ways for method in way.choices(azimuths, radius_px, most_px)]
        work = workload(plans[0], self._lens, self._radiance)  # the same for all
        nanoseconds = [cost.nanoseconds(work, plan) for plan in plans]
        least = int(np.argmin(nanoseconds))
        return nanoseconds[least], plans[least]

    def _plan(self, method, share, radius_px, taps):
        """A plan by one of the methods; without a table nothing is taken for flat."""
        single_range = np.inf
        if self._precision == "float64":
            single_range = 0.0
        elif method.transforms:
            single_range = self._rounding / (SINGLE_NOISE * (method.space_px / method.section_size) ** 2)
        halo_energy = self._energy(HALO_SHARE) if method.azimuths else None
        return Plan(method=method, psf_radius_px=radius_px, psf_energy=self._energy(share), taps=taps,
                    halo_energy=halo_energy, halo_radius_px=self._psfs.reach(halo_energy)[0] if halo_energy else 0,
                    precision=self._precision, single_range=single_range,
                    flat_tolerance=self._flat if method.azimuths else 0.0, folded=self._folded,
                    out_of_field=self._options.out_of_field)

    def _isoplanatic_error(self):
        """The error of one PSF, that of the middle of the planes in work, for the whole field; or what is too much."""
        worst = 0.0
        for psfs in self._trimmed(ONE_PSF_TRIM_SHARE, widest=ONE_PSF_TRIM_SHARE):
            middle = [np.array([(n - 1) / 2]) for n in psfs.planes.grid.shape_px]
            worst = max(worst, isoplanatic_error(psfs.bank, psfs.psfs(*middle)[0], psfs.last_height_mm(),
                                                 ISOPLANATIC_SAMPLES))
            if worst > self._enough:
                break
        return worst

    def _azimuths(self, share):
        """The least number of azimuths that errs by no more than is left, and the error with that of trimming; 0 where
        there is none."""
        wavelengths = [_errors(psfs) for psfs in self._trimmed(share)]
        wanted = 0.9 * self._guess(share)
        while wanted <= AZIMUTH_CHOICES[-1]:
            azimuths = AZIMUTH_CHOICES[int(np.searchsorted(AZIMUTH_CHOICES, wanted))]
            error = azimuth_error(wavelengths[:1], azimuths, self._enough)
            if error <= self._enough and wavelengths[1:]:  # which as a rule err less
                error = max(error, azimuth_error(wavelengths[1:], azimuths, self._enough))
            if error <= self._enough:
                return azimuths, error
            mixing = (error - share * self._enough) / self._left(share)
            wanted = max(azimuths + 1, azimuths * np.sqrt(mixing))  # no power is greater than the second
        return 0, 0.0


def _errors(psfs):
    return AzimuthErrors(psfs.bank, psfs.last_height_mm())
