"""Channel: data of one wavelength that depend on the lens, the plan and the pixel grid, but not on the picture."""

from collections.abc import Callable

import numpy as np
import scipy

from ..blur.even_light import even_light, flat_slope
from ..blur.halos import highlights
from ..blur.overlap_add import overlap_add
from ..blur.section_needs import SectionNeeds, section_needs
from ..field.field_map import Cells, MonochromaticField
from ..image.pixel_grid import PixelGrid
from ..image.sharpening import OF_PARTS, parts_variance, resampling_variance, sharpen
from ..plan.plan import Plan
from ..runtime.memory import MemoryBudget

SHIFT_STEP_PX = 16  # between places whose shift is computed; linear interpolation between them is accurate to 0.01 px


class Channel:
    """A lens at one wavelength, on one pixel grid, by one plan.

    Parameters
    ----------
    field : MonochromaticField
    grid : PixelGrid
        The pixels of the filter, over the complete capture.
    plan : Plan
    table : Cells or None
        Table of the PSFs at this wavelength, if the plan needs one.
    memory : MemoryBudget
        For data that the next picture reuses; `cached` is whether there is enough for the channel itself.
    make_halos : callable () -> Cells, optional
        Returns the table of halos. It is called for pictures with highlights; None if the plan has no halos.
    capture : PixelGrid, optional
        The pixels of the radiance, if they differ from the pixels of the filter.

    Attributes
    ----------
    gpu : str
        The graphics processor that has spread light of the last picture; "" for none.
    """

    def __init__(self, field: MonochromaticField, grid: PixelGrid, plan: Plan, table: Cells | None,
                 memory: MemoryBudget, make_halos: Callable[[], Cells] | None = None,
                 capture: PixelGrid | None = None) -> None:
        self.field, self.planes = field, plan.planes(grid)
        self._plan, self._table = plan, table
        self._psfs = field.psfs(plan.trimmed, self.planes)
        self.cached = memory.take(field.nbytes + (table.nbytes if table else self._psfs.nbytes))
        memory = memory if self.cached else MemoryBudget(0)
        self._ideal = field.ideal_image(capture or grid, self.planes, memory=memory,
                                        vignette=plan.out_of_field == "vignette", precision=plan.precision)
        self._spreader = plan.method.spreader(self._psfs, table, plan.psf_radius_px, memory)
        self._make_halos, self._halos, self._memory = make_halos, None, memory
        self._capture, self.gpu = capture or grid, ""
        self._flat_slope = flat_slope(table, self._psfs, plan.flat_tolerance) if table else 0.0

    def ideal_irradiance(self, radiance: np.ndarray) -> np.ndarray:
        """Distorted irradiance of a plane of radiance, before the blur: array (plane, row, column) of `planes`."""
        return self._ideal.irradiance(radiance)

    def behind_glass(self, irradiance: np.ndarray, sensor: PixelGrid) -> np.ndarray:
        """Irradiance by rays on a sensor, array (row, column), times the transmittance of the glass.

        Beyond the lens data it is 0 if the plan leaves this area black.
        """
        transmitted = irradiance * np.float32(self.field.transmittance)
        if self._plan.out_of_field == "vignette":
            x_mm, y_mm = sensor.axes_mm()
            transmitted[~self.field.within(x_mm, y_mm[:, None])] = 0
        return transmitted

    def veil(self, ideal: np.ndarray, clear: np.ndarray) -> None:
        """Multiply an ideal irradiance in place by a share: array (row, column) of the frame, extended at its edges."""
        picture = self.planes.picture
        margins = [((all_px - n) // 2,) * 2 for all_px, n in zip(picture.shape_px, clear.shape, strict=True)]
        ideal *= self.planes.split(np.pad(clear, margins, mode="edge"))

    def blur(self, ideal: np.ndarray) -> np.ndarray:
        """Blur the ideal irradiance: array (row, column) of the picture with a margin that holds all light.

        This overwrites `ideal`.
        """
        plan, planes, radius = self._plan, self.planes, self._plan.psf_radius_px
        size = plan.method.section_size
        needs = section_needs(ideal, planes, size, radius, plan.single_range, self._flat_slope)
        even = None
        if self._table and needs.flat.any():
            even = even_light(ideal, needs.flat, size, self._psfs, self._table)
        planes.without_doubles(ideal)
        dark = ideal.min()
        blurred = planes.join(overlap_add(ideal, self._spreader, needs), radius)
        self.gpu = self._spreader.gpu
        if even is not None:
            mask, values = planes.join(even[0]), planes.join(even[1])
            rows, columns = (slice(radius, radius + n) for n in mask.shape)
            np.copyto(blurred[rows, columns], values, where=mask)
        halos = highlights(ideal, size, plan.halo_density) if self._make_halos else None
        if halos:
            blurred = self._with_halos(blurred, *halos)
        if dark >= 0 and (plan.method.transforms or halos):  # other weights are not negative
            np.maximum(blurred, 0, out=blurred)  # values below zero are the rounding of transforms, or of halos
        return blurred

    def sharpen(self, blurred: np.ndarray) -> None:
        """Subtract the softening by the parts of pixels from a blurred picture, in place."""
        known = self._capture.pitch_um / self.planes.picture.pitch_um
        shifts = self._shifts(blurred.shape) if known == 1 else None

        def variance(axis, rows, columns):
            width = known / self._capture.across if axis else known
            if shifts and width == 1:
                return OF_PARTS + resampling_variance(shifts[axis](rows, columns))
            return parts_variance(width)

        sharpen(blurred, variance)

    def _shifts(self, shape_px):
        """The shift of light along each axis, from the capture to a picture of this shape around the planes' middle:
        functions of rows and columns, in pixels."""
        grid = self.planes.picture
        grid = grid.framed((shape_px[0] - grid.shape_px[0]) // 2)
        rows, columns = (np.arange(0, n + SHIFT_STEP_PX, SHIFT_STEP_PX) for n in shape_px)
        x_mm, y_mm = grid.position_mm(rows[:, None], columns)
        from_x_mm, from_y_mm = self.field.source_mm(x_mm, y_mm, self._capture)
        return [scipy.interpolate.RectBivariateSpline(rows, columns, moved_mm / (grid.pitch_um * 1e-3), kx=1, ky=1)
                for moved_mm in (y_mm - from_y_mm, from_x_mm - x_mm)]

    def _with_halos(self, blurred, bright, sections):
        """Add the halos of the bright light in these sections to a blurred picture."""
        spreader = self._halos
        if spreader is None:
            table = self._make_halos()
            spreader = self._plan.halo_method.spreader(self._psfs, table, self._plan.halo_radius_px, self._memory)
            if self._memory.take(table.nbytes):
                self._halos = spreader
        none = np.zeros_like(sections)
        picture = self.planes.join(overlap_add(bright, spreader, SectionNeeds(sections, none, none)),
                                   spreader.radius_px)
        self.gpu = self.gpu or spreader.gpu
        beyond = spreader.radius_px - self._plan.psf_radius_px
        rows, columns = (slice(beyond, beyond + n) for n in blurred.shape)
        picture[rows, columns] += blurred
        return picture
