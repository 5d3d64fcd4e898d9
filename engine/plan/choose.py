"""make_plan(): from what is asked to how it is done. An accuracy is met at the least predicted work."""

import time
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..blur import METHODS, Method, OnePsf
from ..blur.method import Workload
from ..field.distortion import FieldGeometry
from ..field.mirror_symmetry import Planes
from ..field.psf_bank import PlacedPsfs, PsfBank
from ..image.spectral_image import SpectralImage
from . import cost
from .error_bound import AzimuthErrors, azimuth_error, isoplanatic_error
from .options import AUTO, DEFAULT_ACCURACY, Options
from .plan import Plan, foldable, knob_plan, psf_support_on

if TYPE_CHECKING:
    from ..lens.lens import Lens

TRIM_SHARE, FLAT_SHARE, ROUNDING_SHARE = 1 / 8, 1 / 16, 1 / 50  # of the accuracy; the rest is the filter's
TRIMMED_TWICE = 2.4  # what is trimmed and what is normalised in its stead, as samples are refined a fifth more at most
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
    LensError
        A wavelength outside the lens data; a distortion that folds the field.
    """
    begin = time.perf_counter()
    plan = _Planner(options, lens, radiance).best() if options.by_result else knob_plan(options, lens, radiance.grid)
    plan = priced(plan, lens, radiance)
    return replace(plan, seconds=plan.seconds + time.perf_counter() - begin)


def workload(plan: Plan, lens: "Lens", radiance: SpectralImage) -> Workload:
    """What the cost of a plan depends on, beside the plan."""
    heights, height_um = lens.heights_mm.size, 1e3 * lens.heights_mm[-1] / lens.heights_mm.size
    return Workload(
        plan.planes(radiance.grid), plan.psf_radius_px, heights, height_um / radiance.pitch_um,
        samples=np.pi / 4 * min(lens.psf.shape[-1], 2 * plan.support_um / lens.psf_pitch_um) ** 2,
        tables=len(_telling_wavelengths(lens, radiance)) / radiance.wavelengths_nm.size)


def priced(plan: Plan, lens: "Lens", radiance: SpectralImage) -> Plan:
    """A plan with the seconds and the memory that it will take on a picture, on this machine."""
    work = workload(plan, lens, radiance)
    return replace(plan, seconds=cost.seconds(work, plan) * radiance.wavelengths_nm.size,
                   memory_mb=cost.memory_mb(work, plan))


def _telling_wavelengths(lens, radiance):
    """The wavelengths that tell the errors of all: those of the picture, or those of the lens data around them,
    whichever are fewer. For between these the PSFs are mixtures, and so are their errors."""
    around = lens.wavelengths_around(radiance.wavelengths_nm)
    return around if len(around) < radiance.wavelengths_nm.size else radiance.wavelengths_nm


class _Planner:
    """Looks for the plan of least predicted work whose error stays within an accuracy.

    A point's light goes wrong by no more than the sum of: twice the energy trimmed, for the rest is normalised; what
    mixing PSFs from those of a few azimuths comes to; what flat sections may; and rounding. That is the bound.
    """

    def __init__(self, options, lens, radiance):
        accuracy = DEFAULT_ACCURACY if options.accuracy is None else options.accuracy
        around = _only_at(lens, lens.wavelengths_around(radiance.wavelengths_nm))
        self._support = psf_support_on(around, radiance.pitch_um, 1 - accuracy * TRIM_SHARE / 2)
        self._options, self._lens, self._radiance = options, lens, radiance
        self._precision = "float32" if accuracy >= SINGLE_ACCURACY else "float64"
        self._flat, self._rounding = accuracy * FLAT_SHARE, accuracy * ROUNDING_SHARE
        self._sure = TRIMMED_TWICE * self._support["trimmed_energy"] + self._flat + self._rounding
        self._share = accuracy - self._sure
        self._planes = Planes(radiance.grid.within_reach(self._support["psf_radius_px"]),
                              foldable(around, radiance.grid))

    def best(self) -> Plan:
        """The plan; the exact operator where nothing less is accurate enough."""
        radius, asked = self._support["psf_radius_px"], self._options.method
        most_px = max(self._planes.grid.shape_px)
        if asked == AUTO:
            error = self._isoplanatic_error()
            if error <= self._share:
                return self._cheapest(OnePsf.choices(0, radius, most_px), error)
        azimuths, error = self._azimuths()
        if not azimuths:
            plan = knob_plan(replace(self._options, accuracy=None, method="exact"), self._lens, self._radiance.grid)
            return replace(plan, error_bound=0.0)
        ways = [way for way in METHODS.values() if way.by_accuracy and asked in (AUTO, way.name)]
        return self._cheapest((method for way in ways for method in way.choices(azimuths, radius, most_px)), error)

    def _cheapest(self, methods: Iterable[Method], error: float) -> Plan:
        plans = [self._plan(method, error) for method in methods]
        return min(plans, key=lambda plan: cost.nanoseconds(workload(plan, self._lens, self._radiance), plan))

    def _plan(self, method, error):
        """A plan by one of the methods, with PSFs that err by this much; without a table nothing is taken for flat."""
        single_range = np.inf
        if self._precision == "float64":
            single_range = 0.0
        elif method.transforms:
            single_range = self._rounding / (SINGLE_NOISE * (method.space_px / method.section_size) ** 2)
        return Plan(method=method, precision=self._precision, single_range=single_range,
                    flat_tolerance=self._flat if method.azimuths else 0.0, folded=self._planes.folded,
                    out_of_field=self._options.out_of_field, error_bound=self._sure + error, **self._support)

    @cached_property
    def _psfs(self):
        """PSFs on the picture's planes, at the wavelengths that tell all errors: a list of PlacedPsfs."""
        optics = [self._lens.at_wavelength(nm) for nm in _telling_wavelengths(self._lens, self._radiance)]
        return [PlacedPsfs(PsfBank.of(each, self._radiance.pitch_um, self._support["support_um"]),
                           FieldGeometry(each, self._lens.name), self._planes) for each in optics]

    def _isoplanatic_error(self):
        """The error of one PSF, that of the middle of the planes in work, for the whole field; or what is too much."""
        worst = 0.0
        for psfs in self._psfs:
            middle = [np.array([(n - 1) / 2]) for n in psfs.planes.grid.shape_px]
            worst = max(worst, isoplanatic_error(psfs.bank, psfs.psfs(*middle)[0], psfs.last_height_mm(),
                                                 ISOPLANATIC_SAMPLES))
            if worst > self._share:
                break
        return worst

    def _azimuths(self):
        """The least number of azimuths that errs by no more than the filter's share, and its error; 0 where none."""
        wavelengths = [AzimuthErrors(psfs.bank, psfs.last_height_mm()) for psfs in self._psfs]
        guess = azimuth_error(wavelengths[:1], GUESS_AZIMUTHS)
        wanted = GUESS_AZIMUTHS * (guess / self._share) ** (1 / GUESS_POWER) * 0.9
        while wanted <= AZIMUTH_CHOICES[-1]:
            azimuths = AZIMUTH_CHOICES[int(np.searchsorted(AZIMUTH_CHOICES, wanted))]
            error = azimuth_error(wavelengths[:1], azimuths, self._share)
            if error <= self._share and wavelengths[1:]:  # which as a rule err less
                error = max(error, azimuth_error(wavelengths[1:], azimuths, self._share))
            if error <= self._share:
                return azimuths, error
            wanted = max(azimuths + 1, azimuths * np.sqrt(error / self._share))  # no power is greater than the second
        return 0, 0.0


def _only_at(lens, wavelengths_nm):
    """The lens with its data at these of its wavelengths alone."""
    own = np.isin(lens.wavelengths_nm, wavelengths_nm)
    return lens if own.all() else replace(lens, **{field: getattr(lens, field)[own] for field in (
        "wavelengths_nm", "real_height_mm", "relative_illumination", "psf", "enclosed_energy", "transmittance")})
