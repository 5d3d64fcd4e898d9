"""make_plan(): from what is asked to how it is done. An accuracy is met at the least predicted time."""

from dataclasses import replace
from functools import cached_property

import numpy as np

from ..field.distortion import FieldGeometry
from ..field.mirror_symmetry import quadrant_grid
from ..field.psf_bank import PlacedPsfs, PsfBank
from ..image.pixel_grid import lay_out
from .cost import Cost
from .error_bound import AzimuthErrors, azimuth_error, isoplanatic_error
from .options import DEFAULT_ACCURACY
from .plan import PIXELS_SECTION, Plan, foldable, knob_plan, psf_support_on, space_px

TRIM_SHARE, FLAT_SHARE, ROUNDING_SHARE = 1 / 8, 1 / 16, 1 / 50  # of the accuracy; the rest is the filter's
TRIMMED_TWICE = 2.4  # what is trimmed and what is normalised in its stead, as samples are refined a fifth more at most
SINGLE_ACCURACY = 3e-5  # the least that single precision is good for
SINGLE_NOISE = 1.2e-7  # of the light, per unit of dynamic range
SECTION_SIZES = (16, 24, 32, 48, 64, 96, 128, 192, 256)
AZIMUTH_CHOICES = tuple(sorted({round(2 ** (k / 2)) for k in range(2, 21)}))
GUESS_AZIMUTHS, GUESS_POWER = 8, 1.6  # errors fall about with this power
ISOPLANATIC_SAMPLES = 4  # azimuths to look at


def make_plan(options, lens, radiance):
    """The plan for filtering a radiance picture: by its knobs, or by the accuracy asked for.

    Raises
    ------
    ImageError
        A pixel pitch so small that the PSFs come out larger than anybody wants.
    LensError
        A wavelength outside the lens data; a distortion that folds the field.
    """
    if not options.by_result:
        plan = knob_plan(options, lens, radiance)
        return Task(lens, radiance, plan.psf_radius_px, plan.support_um, plan.folded).priced(plan)
    accuracy = DEFAULT_ACCURACY if options.accuracy is None else options.accuracy
    return _Planner(options, lens, radiance, accuracy).best()


def _only_at(lens, wavelengths_nm):
    """The lens with its data at these of its wavelengths alone."""
    own = np.isin(lens.wavelengths_nm, wavelengths_nm)
    return lens if own.all() else replace(lens, **{field: getattr(lens, field)[own] for field in (
        "wavelengths_nm", "real_height_mm", "relative_illumination", "psf", "enclosed_energy", "transmittance")})


class Task:
    """A picture to be filtered through a lens, as far as the plan has to know it.

    Attributes
    ----------
    work_px : (int, int)
        Rows and columns of the planes in work: of the picture with its margin, or its quadrants.
    psfs : list of PlacedPsfs
        At the wavelengths that tell the errors of all: those of the picture, or those of the lens data around them,
        whichever are fewer. For between these the PSFs are mixtures, and so are their errors.
    """

    def __init__(self, lens, radiance, psf_radius_px, support_um, folded):
        grid, _ = lay_out(radiance, psf_radius_px)
        self.work_px, self._centre_px = quadrant_grid(grid.picture_px) if folded else (grid.picture_px, grid.centre_px)
        self._lens, self._radiance, self._support_um = lens, radiance, support_um
        samples = np.pi / 4 * min(lens.psf.shape[-1], 2 * support_um / lens.psf_pitch_um) ** 2
        height_px = lens.heights_mm[-1] / lens.heights_mm.size / (radiance.pitch_um * 1e-3)
        tables = len(self._telling_wavelengths()) / radiance.wavelengths_nm.size
        self.cost = Cost(grid.picture_px, self.work_px, self._centre_px, lens.heights_mm.size, height_px, samples,
                         psf_radius_px, tables)

    @cached_property
    def psfs(self):
        return [self._psfs_at(nm) for nm in self._telling_wavelengths()]

    def _psfs_at(self, wavelength_nm):
        optics = self._lens.at_wavelength(wavelength_nm)
        bank = PsfBank(optics, self._radiance.pitch_um, self._support_um)
        field = FieldGeometry(optics, self._lens.name)
        return PlacedPsfs(bank, field, self._radiance.pitch_um, self._centre_px)

    def _telling_wavelengths(self):
        around = self._lens.wavelengths_around(self._radiance.wavelengths_nm)
        return around if len(around) < self._radiance.wavelengths_nm.size else self._radiance.wavelengths_nm

    def last_height_mm(self, psfs):
        """The largest field height in the picture."""
        corners = np.meshgrid((0, self.work_px[0] - 1), (0, self.work_px[1] - 1))
        return float(psfs.place(*corners)[0].max())

    def priced(self, plan):
        """A plan with the seconds and the memory that it will take."""
        seconds = self.cost.seconds(plan) * self._radiance.wavelengths_nm.size
        return replace(plan, seconds=seconds, memory_mb=self.cost.memory_mb(plan))


class _Planner:
    """Looks for the plan of least predicted time whose error stays within an accuracy.

    A point's light goes wrong by no more than the sum of: twice the energy trimmed, for the rest is normalised; what
    mixing PSFs from those of a few azimuths comes to; what flat sections may; and rounding. That is the bound.
    """

    def __init__(self, options, lens, radiance, accuracy):
        around = _only_at(lens, lens.wavelengths_around(radiance.wavelengths_nm))
        support = psf_support_on(around, radiance.pitch_um, 1 - accuracy * TRIM_SHARE / 2)
        self._options, self._lens, self._radiance = options, lens, radiance
        self._precision = "float32" if accuracy >= SINGLE_ACCURACY else "float64"
        self._common = dict(support, non_negative=options.non_negative, precision=self._precision,
                            flat_tolerance=accuracy * FLAT_SHARE, folded=foldable(around, radiance),
                            out_of_field=options.out_of_field)
        self._rounding = accuracy * ROUNDING_SHARE
        self._sure = TRIMMED_TWICE * support["trimmed_energy"] + self._common["flat_tolerance"] + self._rounding
        self._share = accuracy - self._sure
        self._task = Task(lens, radiance, support["psf_radius_px"], support["support_um"], self._common["folded"])

    def best(self):
        """The plan; "exact" where nothing less is accurate enough."""
        sizes = sorted({min(size, max(self._task.work_px)) for size in SECTION_SIZES})
        error = self._isoplanatic_error()
        if error <= self._share and self._options.method == "auto":
            return self._cheapest(self._sections_plan("sections", size, 0, error) for size in sizes)
        azimuths, error = self._azimuths()
        if not azimuths:
            plan = knob_plan(replace(self._options, accuracy=None, method="exact"), self._lens, self._radiance)
            return replace(self._task.priced(plan), error_bound=0.0)
        plans = []
        if self._options.method != "polar":
            plans.append(self._sections_plan("pixels", PIXELS_SECTION, azimuths, error))
        if self._options.method != "pixels":
            plans += [self._sections_plan("polar", size, azimuths, error) for size in sizes]
        return self._cheapest(plans)

    @staticmethod
    def _cheapest(plans):
        return min(plans, key=lambda plan: plan.seconds)

    def _sections_plan(self, method, size, azimuths, error):
        """A plan by one of the methods, with PSFs that err by this much; without a table nothing is taken for flat."""
        space = space_px(size, self._common["psf_radius_px"])
        single_range = self._rounding / (SINGLE_NOISE * (space / size) ** 2) if self._precision == "float32" else 0.0
        return self._task.priced(Plan(
            method=method, section_size=size, order=0 if method == "sections" else 1, space_px=space, azimuths=azimuths,
            single_range=np.inf if method == "pixels" and single_range else single_range,
            error_bound=self._sure + error,
            **self._common | ({} if azimuths else {"flat_tolerance": 0.0})))

    def _isoplanatic_error(self):
        """The error of one PSF, that of the middle of the planes in work, for the whole field; or what is too much."""
        middle, worst = [np.array([(n - 1) / 2]) for n in self._task.work_px], 0.0
        for psfs in self._task.psfs:
            worst = max(worst, isoplanatic_error(psfs.bank, psfs(*middle)[0], self._task.last_height_mm(psfs),
                                                 ISOPLANATIC_SAMPLES))
            if worst > self._share:
                break
        return worst

    def _azimuths(self):
        """The least number of azimuths that errs by no more than the filter's share, and its error; 0 where none."""
        wavelengths = [AzimuthErrors(psfs.bank, self._task.last_height_mm(psfs)) for psfs in self._task.psfs]
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
