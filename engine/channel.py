"""One wavelength's way through the lens: all that depends on the lens and the pixel grid, and not on the picture."""

from collections.abc import Callable

import numpy as np

from .blur.even_light import even_light, flat_slope
from .blur.halos import highlights
from .blur.overlap_add import overlap_add
from .blur.section_needs import SectionNeeds, section_needs
from .field.distortion import FieldGeometry
from .field.ideal_image import IdealImage
from .field.psf_bank import PlacedPsfs, PsfBank
from .field.psf_table import PsfCells
from .image.pixel_grid import PixelGrid
from .lens import Lens
from .memory import MemoryBudget
from .plan.plan import Plan


class Channel:
    """A lens at one wavelength, on one pixel grid, by one plan.

    Parameters
    ----------
    lens : Lens
    wavelength_nm : float
    capture : PixelGrid
        Of the radiance.
    plan : Plan
    table : PsfCells or None
        Of the PSFs at this wavelength, where the plan needs one.
    memory : MemoryBudget
        For what pictures share, to keep it for the next one; `kept` says whether the channel itself found any.
    make_halos : callable () -> PsfCells, where the plan has halos
        The table of them; called once a picture has highlights.
    """

    def __init__(self, lens: Lens, wavelength_nm: float, capture: PixelGrid, plan: Plan, table: PsfCells | None,
                 memory: MemoryBudget, make_halos: Callable[[], PsfCells] | None = None) -> None:
        optics = lens.at_wavelength(wavelength_nm)
        self.field = FieldGeometry(optics, lens.name)
        self.planes = plan.planes(capture)
        self._plan, self._table, self._transmittance = plan, table, optics.transmittance
        self._psfs = PlacedPsfs(lambda: plan.trimmed(PsfBank.of(optics, capture.pitch_um)), self.field, self.planes)
        self.kept = memory.take(self.field.nbytes + (table.nbytes if table else self._psfs.bank.nbytes))
        memory = memory if self.kept else MemoryBudget(0)
        self._ideal = IdealImage(lens, self.field, optics.transmittance, capture, self.planes, memory=memory,
                                 vignette=plan.out_of_field == "vignette", precision=plan.precision)
        self._spreader = plan.method.spreader(self._psfs, table, plan.psf_radius_px, memory)
        self._make_halos, self._halos, self._memory = make_halos, None, memory
        self._flat_slope = flat_slope(table, self._psfs, plan.flat_tolerance) if table else 0.0

    def ideal_irradiance(self, radiance: np.ndarray) -> np.ndarray:
        """Irradiance of a plane of radiance where the lens puts it, before any blur: array (plane, row, column) of
        `planes`."""
        return self._ideal.irradiance(radiance)

    def behind_glass(self, irradiance: np.ndarray, sensor: PixelGrid) -> np.ndarray:
        """What rays bring to a sensor, array (row, column), less what the lens's glass takes; none beyond the lens data
        where the plan has it stay black."""
        transmitted = irradiance * np.float32(self._transmittance)
        if self._plan.out_of_field == "vignette":
            x_mm, y_mm = sensor.axes_mm()
            transmitted[np.hypot(x_mm, y_mm[:, None]) > self.field.last_real_mm] = 0
        return transmitted

    def veil(self, ideal: np.ndarray, clear: np.ndarray) -> None:
        """Leave, in place, a share of an ideal irradiance: array (row, column) of the frame, which goes on around it
        as at its edges."""
        picture = self.planes.picture
        margins = [((all_px - n) // 2,) * 2 for all_px, n in zip(picture.shape_px, clear.shape, strict=True)]
        ideal *= self.planes.split(np.pad(clear, margins, mode="edge"))

    def blur(self, ideal: np.ndarray) -> np.ndarray:
        """The ideal irradiance blurred: array (row, column) of the picture and a margin around it that holds all light.
        `ideal` is used up."""
        plan, planes, radius = self._plan, self.planes, self._plan.psf_radius_px
        size = plan.method.section_size
        needs = section_needs(ideal, planes, size, radius, plan.single_range, self._flat_slope)
        even = None
        if self._table and needs.flat.any():
            even = even_light(ideal, needs.flat, size, self._psfs, self._table)
        planes.without_doubles(ideal)
        dark = ideal.min()
        blurred = planes.join(overlap_add(ideal, self._spreader, needs), radius)
        if even is not None:
            mask, values = (planes.join(part) for part in even)
            rows, columns = (slice(radius, radius + n) for n in mask.shape)
            np.copyto(blurred[rows, columns], values, where=mask)
        if self._make_halos and (found := highlights(ideal, size, plan.halo_density)):
            blurred = self._with_halos(blurred, *found)
        if dark >= 0:
            np.maximum(blurred, 0, out=blurred)  # no weight is negative: what falls below zero is the FFT's rounding
        return blurred

    def _with_halos(self, blurred, bright, sections):
        """A blurred picture with the halos of the bright light in these sections."""
        spreader = self._halos
        if spreader is None:
            table = self._make_halos()
            spreader = self._plan.halo_method.spreader(self._psfs, table, self._plan.halo_radius_px, self._memory)
            if self._memory.take(table.nbytes):
                self._halos = spreader
        none = np.zeros_like(sections)
        picture = self.planes.join(overlap_add(bright, spreader, SectionNeeds(sections, none, none)),
                                   spreader.radius_px)
        beyond = spreader.radius_px - self._plan.psf_radius_px
        rows, columns = (slice(beyond, beyond + n) for n in blurred.shape)
        picture[rows, columns] += blurred
        return picture
