"""One wavelength's way through the lens: all that depends on the lens and the pixel grid, and not on the picture."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from .blur.exact import filter_exactly
from .blur.isoplanatic import FourierSections
from .blur.overlap_add import overlap_add
from .blur.pixels import PixelSections
from .blur.polar_sections import PolarSections
from .blur.section_needs import judge_content
from .field.distortion import RIM_PX, FieldGeometry, footprints
from .field.mirror_symmetry import quadrant_grid, quadrants, unfold, without_doubles
from .field.overscan import image_radius
from .field.psf_bank import PlacedPsfs, PsfBank
from .image.irradiance import irradiance_per_radiance
from .image.spectral_image import pixel_axes_mm
from .room import Room

BAND_PIXELS = 1 << 16


class Channel:
    """A lens at one wavelength, on one grid, by one plan.

    Parameters
    ----------
    lens : Lens
    wavelength_nm : float
    grid : Grid
    plan : Plan
    tables : PolarTables or None
    room : Room
        For what pictures share, to keep it for the next one; `kept` says whether the channel found any.
    """

    def __init__(self, lens, wavelength_nm, grid, plan, tables, room):
        optics = lens.at_wavelength(wavelength_nm)
        self.field = FieldGeometry(optics, lens.name)
        self._lens, self._optics, self._grid, self._plan = lens, optics, grid, plan
        self._bank = PsfBank(optics, grid.pitch_um, plan.support_um)
        self._folded = plan.folded
        shape = grid.picture_px
        if self._folded:
            self._work_px, self._centre_px = quadrant_grid(shape)
            self._capture_px = tuple(n - n // 2 + 2 * RIM_PX for n in grid.capture_px)
            self._capture_centre_px = tuple(centre + RIM_PX for centre in self._centre_px)
        else:
            self._work_px, self._centre_px = shape, grid.centre_px
            self._capture_px = tuple(n + 2 * RIM_PX for n in grid.capture_px)
            self._capture_centre_px = tuple(centre + RIM_PX for centre in grid.capture_centre_px)
        self._psfs = PlacedPsfs(self._bank, self.field, grid.pitch_um, self._centre_px)
        self._bands = {}
        self._table = tables.at_wavelength(wavelength_nm) if tables else None
        self.kept = room.take(self._bank.nbytes + (self._table.nbytes if self._table else 0))
        self._room = room if self.kept else Room(0)
        self._spreader = self._make_spreader()

    def ideal_irradiance(self, radiance):
        """Irradiance of a plane of radiance where the lens puts it, before any blur: array (plane, row, column).

        Where the axis is in the middle the planes are the four quadrants about it, else it is one.
        """
        framed = np.pad(radiance, RIM_PX)
        capture = quadrants(framed, RIM_PX) if self._folded else framed[None]
        ideal = np.empty((len(capture), *self._work_px), self._plan.precision)
        x_mm, y_mm = pixel_axes_mm(self._work_px, self._centre_px, self._grid.pitch_um)

        def work(rows):
            band, factor = self._band(rows, x_mm, y_mm)
            ideal[:, rows] = band.average(capture) * factor

        step = max(1, BAND_PIXELS // x_mm.size)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(work, (slice(top, min(top + step, y_mm.size)) for top in range(0, y_mm.size, step))))
        return ideal

    def _band(self, rows, x_mm, y_mm):
        """Footprints of a band of rows, and irradiance per radiance in it."""
        if rows.start in self._bands:
            return self._bands[rows.start]
        band, height_mm = footprints(self._capture_px, self._capture_centre_px, x_mm, y_mm[rows], self._grid.pitch_um,
                                     self.field, image_radius(self._grid.projection, self._lens), self._plan.precision)
        per_radiance = irradiance_per_radiance(self._optics.transmittance, self._lens.f_number_effective)
        factor = (per_radiance * self.field.relative_illumination(height_mm)).astype(self._plan.precision)
        if self._plan.out_of_field == "vignette":
            factor[height_mm > self._lens.heights_mm[-1]] = 0
        if self._room.take(band.nbytes + factor.nbytes):
            self._bands[rows.start] = band, factor
        return band, factor

    def light(self, ideal):
        """The sum of the planes of `ideal_irradiance`, as a picture."""
        light = ideal.sum(dtype=np.float64)
        if self._folded:  # middle lines are in two planes
            rows, columns = (n % 2 for n in self._grid.picture_px)
            light -= ideal[1::2, :rows].sum(dtype=np.float64) + ideal[2:, :, :columns].sum(dtype=np.float64)
            light += ideal[3:, :rows, :columns].sum(dtype=np.float64)
        return light

    def blur(self, ideal):
        """The planes of `ideal_irradiance` blurred: array (row, column) of the picture and a canvas of one PSF radius
        around it, which holds all light. `ideal` is used up."""
        plan, radius = self._plan, self._plan.psf_radius_px
        if plan.method == "exact":
            return filter_exactly(ideal[0], radius, self._psfs)
        content = judge_content(ideal, plan.section_size, radius, plan.single_range, self._flat_slope(), self._folded)
        even = self._even_light(ideal, content.flat) if content.flat.any() else None
        if self._folded:
            without_doubles(ideal, self._grid.picture_px)
        dark = ideal.min()
        canvas = self._whole(overlap_add(ideal, self._spreader, content), radius)
        if even is not None:
            mask, values = (self._whole(planes, 0) for planes in even)
            np.copyto(canvas[radius:radius + mask.shape[0], radius:radius + mask.shape[1]], values, where=mask)
        if plan.weights_positive and dark >= 0:
            np.maximum(canvas, 0, out=canvas)  # no weight is negative: what falls below zero is the FFT's rounding
        return canvas

    def _whole(self, planes, radius_px):
        """The picture of its planes, with a canvas of this radius."""
        return unfold(planes, self._grid.picture_px, radius_px) if self._folded else planes[0]

    def _make_spreader(self):
        plan, table = self._plan, self._table
        if plan.method == "exact":
            return None
        if plan.method == "pixels":
            return PixelSections(plan.section_size, plan.psf_radius_px, table, self._psfs.place, room=self._room)
        if plan.method == "polar":
            return PolarSections(plan.section_size, plan.space_px, plan.psf_radius_px, table, self._psfs.place,
                                 self._room)
        node_psfs = PlacedPsfs(table, self.field, self._grid.pitch_um, self._centre_px) if table else self._psfs
        return FourierSections(self._work_px, plan.section_size, plan.order, plan.space_px, plan.psf_radius_px,
                               node_psfs, non_negative=plan.non_negative, room=self._room)

    def _flat_slope(self):
        """Relative change from pixel to pixel that blur may ignore; 0 where none.

        A pixel's light comes from pixels whose distance, the steps along x and y, is on the mean `steps_px`; it then
        differs from that of even light by no more than the slope times this. And even light stays even, as
        `_even_light` has it, but for what the PSFs' spread changes over the field.
        """
        distance_px = self._bank.mean_distance_px()
        field_px = self.field.last_real_mm / (self._grid.pitch_um * 1e-3)
        tolerance = self._plan.flat_tolerance - 2 * (distance_px / field_px) ** 2
        steps_px = np.sqrt(2) * distance_px + 1
        return max(tolerance, 0) / 2 / steps_px

    def _even_light(self, ideal, flat):
        """Which pixels lie in flat sections, and what they come to: arrays (plane, row, column).

        Even light stays even but where PSFs lean more, or less, from place to place: where the light of a pixel moves
        by m on the mean, its density becomes 1 - div m.
        """
        size = self._plan.section_size
        mask, values = np.zeros(ideal.shape, dtype=bool), np.zeros_like(ideal)

        def write_down(section):
            i, j = section
            down, right = self._mean_offsets_px(np.arange(-1, size + 1) + i * size, np.arange(-1, size + 1) + j * size)
            density = 1 - (down[2:, 1:-1] - down[:-2, 1:-1]) / 2 - (right[1:-1, 2:] - right[1:-1, :-2]) / 2
            inside = (slice(None), slice(i * size, (i + 1) * size), slice(j * size, (j + 1) * size))
            mask[inside] = True
            values[inside] = ideal[inside] * density[:ideal[inside].shape[1], :ideal[inside].shape[2]]

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(write_down, np.argwhere(flat)))
        if self._folded:
            mask, values = (without_doubles(planes, self._grid.picture_px) for planes in (mask, values))
        return mask, values

    def _mean_offsets_px(self, rows, columns):
        """How far down and to the right light moves on the mean, from these rows and columns: two arrays."""
        # Of a quadrant what lies across the axis is mirrored, as its offsets are.
        own = list(zip((rows, columns), self._centre_px))
        signs = [np.where(self._folded & (at < centre), -1, 1) for at, centre in own]
        grid = np.meshgrid(*(centre + sign * (at - centre) for sign, (at, centre) in zip(signs, own)), indexing="ij")
        offsets = self._table.mean_offsets_px(*self._psfs.place(*(axis.ravel() for axis in grid)))
        down, right = offsets.reshape(2, rows.size, columns.size)
        return signs[0][:, None] * down, signs[1] * right
