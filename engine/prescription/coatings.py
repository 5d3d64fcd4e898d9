"""Coatings of surfaces, and the light that they reflect: stacks of thin films, or measured reflectances."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ..runtime.errors import LensError
from .glasses import LARGEST_INDEX

IDEAL, NONE, SINGLE, MULTI = "ideal", "none", "single", "multi"
AS_LENS = "lens"  # choice of a setting
MOST_LAYERS, THICKEST_NM = 100, 1e5
EVERYWHERE_NM = (0.0, np.inf)
INNER = 1.65  # index of the inner layer of "multi"
EYE_NM, BAND_NM = 550.0, 510.0  # centres, in wavenumber, of the eye's sensitivity and of the visible range


@dataclass(frozen=True)
class MeasuredReflectance:
    """Reflectance over wavelength and angle, interpolated linearly; beyond the angles, the nearest one's.

    Attributes
    ----------
    wavelengths_nm : tuple of float
        Ascending.
    angles_deg : tuple of float
        Ascending: between the light in air and the normal of the surface.
    values : tuple of tuple of float
        0 to 1, for unpolarised light: a row for each wavelength, with a number for each angle.
    """

    wavelengths_nm: tuple[float, ...]
    angles_deg: tuple[float, ...]
    values: tuple[tuple[float, ...], ...]

    def at(self, wavelengths_nm: np.ndarray, angles_deg: np.ndarray) -> np.ndarray:
        """Reflectances at wavelengths and angles, arrays that broadcast; NaN beyond the wavelengths."""
        nm, angles_deg = np.broadcast_arrays(wavelengths_nm, angles_deg)
        places = [np.interp(each, nodes, np.arange(len(nodes)))
                  for each, nodes in ((nm, self.wavelengths_nm), (angles_deg, self.angles_deg))]
        values = scipy.ndimage.map_coordinates(np.array(self.values), places, order=1, mode="nearest")
        return np.where((nm >= self.wavelengths_nm[0]) & (nm <= self.wavelengths_nm[-1]), values, np.nan)


@dataclass(frozen=True)
class Coating:
    """The coating of a surface: layers without absorption or dispersion, or a measured reflectance.

    Attributes
    ----------
    name : str
    layers : tuple of (float, float)
        Refractive index and thickness in nm of each layer, from the medium of lower index, usually air, to the other.
        () for bare glass.
    measured : MeasuredReflectance or None
        It replaces the layers. The rest of the light gets through.

    Raises
    ------
    LensError
        A value out of range.
    """

    name: str
    layers: tuple[tuple[float, float], ...] = ()
    measured: MeasuredReflectance | None = None

    def __post_init__(self) -> None:
        if not self.name:
            raise self._refusal("name", self.name, "expected one")
        if len(self.layers) > MOST_LAYERS:
            raise self._refusal("layers", len(self.layers), f"expected at most {MOST_LAYERS}")
        for number, (index, thickness_nm) in enumerate(self.layers, 1):
            if not 1 <= index < LARGEST_INDEX:
                raise self._refusal(f"layer {number}, index", index, f"expected 1 to {LARGEST_INDEX:g}")
            if not 0 < thickness_nm <= THICKEST_NM:
                raise self._refusal(f"layer {number}, thickness", thickness_nm, f"expected 0 to {THICKEST_NM:g} nm")
        if self.measured:
            self._check_measured(self.measured)

    def _check_measured(self, table):
        if self.layers:
            raise self._refusal("layers", self.layers, "expected either layers or a measured reflectance")
        for field, nodes in (("wavelengths_nm", table.wavelengths_nm), ("angles_deg", table.angles_deg)):
            if not nodes or nodes[0] < 0 or not np.all(np.diff(nodes) > 0):
                raise self._refusal(field, nodes, "expected ascending numbers")
        if table.angles_deg[-1] > 90:
            raise self._refusal("angles_deg", table.angles_deg[-1], "expected at most 90")
        shape = len(table.wavelengths_nm), len(table.angles_deg)
        if len(table.values) != shape[0] or any(len(row) != shape[1] for row in table.values):
            raise self._refusal("reflectance", f"{len(table.values)} rows", f"expected {shape[0]} rows of {shape[1]} "
                                "numbers: one for each wavelength, with one for each angle")
        if not np.all((np.array(table.values) >= 0) & (np.array(table.values) <= 1)):
            raise self._refusal("reflectance", "out of range", "expected numbers from 0 to 1")

    def _refusal(self, field, value, remedy):
        return LensError("prescription", f"coating {self.name or 'without a name'}, {field}", value, remedy)


def quarter_waves(centre_nm: float, *layers: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    """Layers of (index, number of quarter waves at `centre_nm`), with thicknesses in nm."""
    return tuple((index, number * centre_nm / (4 * index)) for index, number in layers)


BUILT_IN = {coating.name: coating for coating in (
    Coating(IDEAL, measured=MeasuredReflectance(EVERYWHERE_NM, (0.0,), ((0.0,), (0.0,)))),
    Coating(NONE),
    Coating(SINGLE, quarter_waves(EYE_NM, (1.38, 1))),
    Coating(MULTI, quarter_waves(BAND_NM, (1.38, 1), (2.1, 2), (INNER, 1))))}
"""Coatings that every prescription can name.

"ideal" reflects nothing, except in total reflection. "none" is bare glass. "single" is MgF2. "multi" is the
quarter-half-quarter of J. T. Cox, G. Hass and A. Thelen, J. Opt. Soc. Am. 52, 965 (1962): MgF2, ZrO2, and a layer of
medium index on the glass; see `on_glass`.
"""
MULTI_ON_DENSE_GLASS = Coating(MULTI, quarter_waves(BAND_NM, (1.38, 1), (2.1, 2), (INNER, 2)))


def on_glass(coating: Coating, index: float) -> Coating:
    """A coating as it is designed for a glass of this index: the inner layer of "multi" is a half wave on glass of a
    higher index than its own."""
    return MULTI_ON_DENSE_GLASS if coating is BUILT_IN[MULTI] and index > INNER else coating


def of_layers(number: int) -> str:
    """Name of the built-in coating with this number of layers, for files that state no more."""
    return (NONE, SINGLE, MULTI)[min(number, 2)]


def coating_of(choice: str) -> str | None:
    """The built-in coating of a setting's choice; None for the coatings of the lens."""
    return None if choice == AS_LENS else choice


def reflectance(coating: Coating, indices: tuple[np.ndarray, np.ndarray], wavelengths_nm: Sequence[float] | np.ndarray,
                invariants: np.ndarray) -> np.ndarray:
    """Reflectance of a coated surface for unpolarised light.

    Snell's law keeps the sine of the angle times the index, so its square names a ray on both sides and in each layer.
    Without absorption, light reflects equally from both sides.

    Parameters
    ----------
    coating : Coating
    indices : (array, array)
        Refractive indices of the media in front of the surface and behind it.
    wavelengths_nm : array
    invariants : array
        (n sin(angle))^2 of rays. All of these arrays broadcast.

    Returns
    -------
    array
        1 in total reflection; NaN at wavelengths beyond a measured reflectance.
    """
    low, high = np.minimum(*indices), np.maximum(*indices)
    low, high, nm, squares = np.broadcast_arrays(low, high, np.asarray(wavelengths_nm, dtype=float), invariants)
    total = squares >= low**2
    squares = np.where(total, 0.0, squares)
    if coating.measured:
        values = coating.measured.at(nm, np.degrees(np.arcsin(np.sqrt(np.clip(squares, 0, 1)))))
    else:
        values = (_of_layers(coating.layers, low, high, nm, squares, 0)
                  + _of_layers(coating.layers, low, high, nm, squares, 2)) / 2
    return np.where(total, 1.0, values)


def _of_layers(layers, low, high, wavelengths_nm, squares, power):
    """Reflectance by the transfer matrix: of s-polarised light with power 0, of p-polarised light with power 2.

    H. A. Macleod, Thin-Film Optical Filters, chapter 2, with q = n cos(angle). Both polarisations have the same
    equations for the tangential fields if p-polarised light counts with the inverse admittance, q / n^2, which stays
    finite at grazing incidence.
    """
    def ratio(index):
        return np.sqrt(index**2 - squares) / index**power

    first, second = np.ones(squares.shape, complex), ratio(high).astype(complex)
    for index, thickness_nm in reversed(layers):
        cosine, sine_per_q, q_sine = _phase(index**2 - squares, 2 * np.pi * thickness_nm / wavelengths_nm)
        first, second = (cosine * first + 1j * sine_per_q * index**power * second,
                         1j * q_sine / index**power * first + cosine * second)
    amplitude = (ratio(low) * first - second) / (ratio(low) * first + second)
    return np.abs(amplitude)**2


def _phase(square, depth):
    """cos(q d), sin(q d) / q and q sin(q d) for q^2 = `square`: real, also where light is evanescent in a layer."""
    q = np.sqrt(square + 0j)
    sine_per_q = (depth * np.sinc(q * depth / np.pi)).real
    return np.cos(q * depth).real, sine_per_q, square * sine_per_q
