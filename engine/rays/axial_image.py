"""Contrast of fine lines on the axis, including diffraction, in many image planes.

A bundle on the axis is a function of its rays' direction cosine alone. Its optical transfer function is the
autocorrelation of the pupil over these cosines, shifted by wavelength times frequency. Another image plane only adds a
phase.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ..prescription.system import System
from ..runtime.errors import LensError
from ..spectral.spectra import colour_matching
from .pupil import gauss_legendre
from .rays import HalfPupil, trace_pupil

FAN = HalfPupil(33, 1)
DEGREE = 5  # of the splines through its rays
RADII, AZIMUTHS = 32, 12  # quadrature over a quarter of the pupil


@dataclass(frozen=True, eq=False)
class AxialBundle:
    """Light of one wavelength that converges to the axial image point.

    Attributes
    ----------
    wavelength_nm : float
    aperture : float
        Numerical aperture: direction cosine of the outermost rays that pass.
    obstruction : float
        Direction cosine of the innermost rays that pass; 0 without a central obstruction.
    path_mm : function
        Optical path of the plane waves at the centre of the image plane, as a function of the direction cosine.
    light : function
        Light per area of direction cosines, as a function of the squared direction cosine.
    crossings_mm : array
        Distances from the image plane at which rays cross the axis.
    """

    wavelength_nm: float
    aperture: float
    obstruction: float
    path_mm: Callable[[np.ndarray], np.ndarray]
    light: Callable[[np.ndarray], np.ndarray]
    crossings_mm: np.ndarray

    @property
    def cutoff_lp_mm(self) -> float:
        """Diffraction cutoff: the frequency at which contrast vanishes."""
        return 2e6 * self.aperture / self.wavelength_nm

    def contrast(self, lp_mm: float, shifts_mm: Sequence[float] | np.ndarray) -> np.ndarray:
        """MTF at a frequency in image planes shifted back from the lens's image plane: array (shift,).

        Negative where contrast is reversed, and 0 beyond the diffraction cutoff.
        """
        shift = lp_mm * self.wavelength_nm * 1e-6
        near, far, areas = _overlap(self.aperture, shift)
        weights = areas * np.sqrt(self._passing(near) * self._passing(far))
        wave_number = 2e6 * np.pi / self.wavelength_nm
        phase = wave_number * (self.path_mm(far) - self.path_mm(near))
        change = wave_number * (np.sqrt(1 - far**2) - np.sqrt(1 - near**2))
        _, distances, all_areas = _overlap(self.aperture, 0.0)
        light = np.sum(all_areas * self._passing(distances))
        return np.cos(phase + np.multiply.outer(shifts_mm, change)) @ weights / light

    def _passing(self, cosine):
        """`light` at direction cosines up to the aperture, and 0 within the central obstruction."""
        return np.where(cosine < self.obstruction, 0, np.maximum(self.light(cosine**2), 0))


def trace_axial_bundles(system: System, wavelengths_nm: Sequence[float] | np.ndarray) -> list[AxialBundle]:
    """Trace the axial bundle at each wavelength.

    Raises
    ------
    LensError
        No light gets through.
    """
    rays = trace_pupil(system, [0.0], wavelengths_nm, FAN)
    limits, surfaces = np.sqrt(system.limits(rays.square_height_mm2[:, :, 0, :, 0])), len(system.glasses)
    limits[system.prescription.stop_index] = FAN.radii
    extents, holes = limits[:surfaces].max(axis=0), limits[surfaces:].max(axis=0, initial=0.0)
    cosine = np.where(rays.lost, np.nan, rays.direction[1])[:, 0, :, 0]
    height_mm = np.where(rays.lost, np.nan, rays.position_mm[1])[:, 0, :, 0]
    source = np.where(rays.lost, np.nan, rays.source[1])[:, 0, :, 0]
    return [_bundle(system, *each) for each in zip(rays.wavelengths_nm, cosine, height_mm, source, extents, holes,
                                                   strict=True)]


def white_mtf(bundles: Sequence[AxialBundle], lp_mm: float, shifts_mm: Sequence[float] | np.ndarray) -> np.ndarray:
    """Contrast in equal-energy light of these wavelengths, weighted by the eye's response: array (shift,)."""
    eye_response = eye_response_at([bundle.wavelength_nm for bundle in bundles])
    return np.average([bundle.contrast(lp_mm, shifts_mm) for bundle in bundles], axis=0, weights=eye_response)


def eye_response_at(wavelengths_nm: Sequence[float] | np.ndarray) -> np.ndarray:
    """Weights of wavelengths in white light: the eye's response or, if it is 0 at all of them, ones."""
    response = colour_matching(wavelengths_nm)[:, 1]
    return response if response.any() else np.ones(len(response))


def _bundle(system, wavelength_nm, cosine, height_mm, source, extent, hole):
    """Bundle from a fan of rays. `extent` is 1 for a ray that touches the edge of an aperture, and `hole`, which falls
    outwards, for one that touches a central obstruction."""
    side = np.sign(cosine[1])
    cosine, height_mm = side * cosine, side * height_mm
    rises = np.append(True, np.diff(cosine) > 0)  # NaN, for lost rays, does not
    count = cosine.size if rises.all() else int(np.argmin(rises))
    if count < 2:
        raise LensError(system.prescription.name, "field height", "0 mm", "only the chief ray gets "
                        f"through here at {wavelength_nm:g} nm: check the surfaces' shapes and apertures")
    cosine, height_mm, source = cosine[:count], height_mm[:count], source[:count]
    extent, hole = extent[:count], hole[:count]
    degree = min(DEGREE, count - 1)
    passing = slice(1, max(2, int(np.sum(extent <= 1))))
    slope = cosine / np.sqrt(1 - cosine**2)
    return AxialBundle(
        wavelength_nm=float(wavelength_nm), aperture=np.interp(1.0, np.maximum.accumulate(extent), cosine),
        obstruction=np.interp(1.0, np.maximum.accumulate(hole[::-1]), cosine[::-1]),
        path_mm=scipy.interpolate.make_interp_spline(cosine, -height_mm, k=degree).antiderivative(),
        light=scipy.interpolate.make_interp_spline(cosine**2, source**2, k=degree).derivative(),
        crossings_mm=-height_mm[passing] / slope[passing])


def _overlap(aperture, shift):
    """Samples of a quarter of two discs' overlap: distances from each centre, and relative areas: arrays (place,)."""
    nodes, weights = gauss_legendre(RADII)
    turns, turn_weights = gauss_legendre(AZIMUTHS)
    azimuth = (turns[:, None] + 1) * np.pi / 4
    up, across = np.sin(azimuth), np.cos(azimuth)
    edge = np.sqrt(np.maximum(aperture**2 - (shift / 2 * across)**2, 0)) - shift / 2 * up
    edge = np.maximum(edge, 0)
    radius = edge * (nodes + 1) / 2
    areas = radius * edge * weights / 2 * turn_weights[:, None]
    near, far = (np.hypot(radius * across, radius * up + side * shift / 2) for side in (-1, 1))
    return near.ravel(), far.ravel(), areas.ravel()
