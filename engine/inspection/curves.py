"""Curves of a lens over the heights of its field: angles, distortion, relative illumination, lateral colour, MTF.

`transfer` and the functions from `white_contrast` on serve all lenses.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..field.radial.distortion import FieldGeometry
from ..field.radial.uniform_light import picture_illumination
from ..lens import Lens
from ..lens.radial_lens import MonochromaticLens, RadialLens
from ..runtime.errors import LensError
from ..spectral.spectra import BAND_NM, colour_matching, linear_weights

WHITE_NM = np.arange(BAND_NM[0], BAND_NM[1] + 1)
GRID_CELLS = 6  # cells of the distortion grid along the short side of the sensor
MOST_GRID_LINES = 40  # beyond the sensor on each side: a hemispherical fisheye could show any number
POINTS_PER_LINE = 401
FREQUENCY_SERIES = np.outer(10.0 ** np.arange(-3, 5), (1, 2, 5)).ravel()
PREFERRED_FREQUENCIES = 3
FINEST_FREQUENCY = 0.1  # of the diffraction cutoff; few lenses have contrast beyond it


@dataclass(frozen=True, eq=False)
class Field:
    """The field of a lens at its reference wavelength.

    Attributes
    ----------
    optics : MonochromaticLens
    geometry : FieldGeometry
    edge_mm : float
        Paraxial height that is imaged on the sensor's corner, or the last height if the lens data end before it.
    reaches_corner : bool
        Whether the lens data reach the sensor's corner.
    """

    optics: MonochromaticLens
    geometry: FieldGeometry
    edge_mm: float
    reaches_corner: bool


def field_of(lens: RadialLens) -> Field:
    """The Field of a lens; raise a LensError if its distortion folds the picture."""
    optics = lens.at_wavelength(reference_nm(lens))
    geometry = FieldGeometry(optics, lens.name)
    corner_mm = np.hypot(*lens.sensor_mm) / 2
    reaches_corner = bool(corner_mm <= geometry.last_real_mm)
    edge_mm = geometry.paraxial_height_mm(corner_mm) if reaches_corner else lens.heights_mm[-1]
    return Field(optics, geometry, float(edge_mm), reaches_corner)


def reference_nm(lens: Lens) -> float:
    """The reference wavelength, or the nearest within the lens data."""
    return float(lens.nearest_nm(lens.reference_wavelength_nm))


def field_angle_rad(lens: RadialLens, paraxial_height_mm: ArrayLike) -> np.ndarray:
    """Object-side angle between the axis and the chief ray for a paraxial image height."""
    return np.arctan(np.asarray(paraxial_height_mm) / lens.capture_focal_length_mm)


def cosine_fourth(lens: RadialLens, paraxial_height_mm: ArrayLike) -> np.ndarray:
    """Relative illumination of a lens without distortion, vignetting or pupil aberration."""
    return np.cos(field_angle_rad(lens, paraxial_height_mm)) ** 4


def distortion_percent(field: Field, paraxial_height_mm: float) -> float:
    """Distortion: the chief ray's distance beyond its paraxial height, in per cent of that height."""
    return float(100 * (field.geometry.distortion(paraxial_height_mm) / paraxial_height_mm - 1))


def distortion_grid(lens: RadialLens, field: Field) -> tuple[np.ndarray, np.ndarray]:
    """Lines of a square grid in the ideal picture, and their images by the lens at the reference wavelength.

    The ideal grid has GRID_CELLS cells along the sensor's short side, and extends beyond the sensor to include all
    lines that the lens images onto it.

    Returns
    -------
    ideal_mm, real_mm : arrays (line, point, 2)
        x and y about the axis; NaN in `real_mm` beyond the lens data.
    """
    furthest = field_angle_rad(lens, field.edge_mm)
    angles = np.linspace(-furthest, furthest, POINTS_PER_LINE)
    along_mm = lens.capture_focal_length_mm * np.tan(angles)  # dense in the middle
    cells = [max(2, round(GRID_CELLS * side / min(lens.sensor_mm))) for side in lens.sensor_mm]
    lines = []
    for side_mm, number, across in zip(lens.sensor_mm, cells, (0, 1), strict=True):
        beyond = min(MOST_GRID_LINES, max(0, int(np.floor((field.edge_mm / side_mm - 0.5) * number + 1e-9))))
        for place_mm in (np.arange(-beyond, number + beyond + 1) / number - 0.5) * side_mm:
            pair = [np.full(along_mm.size, place_mm), along_mm]
            lines.append(np.stack(pair[::-1] if across else pair, axis=-1))
    ideal_mm = np.stack(lines)
    paraxial_mm = np.hypot(ideal_mm[..., 0], ideal_mm[..., 1])
    known = np.where(paraxial_mm <= lens.heights_mm[-1] * (1 + 1e-9), paraxial_mm, np.nan)
    return ideal_mm, ideal_mm / field.geometry.paraxial_per_real(field.geometry.distortion(known), known)[..., None]


def relative_illumination(lens: RadialLens, wavelengths_nm: ArrayLike) -> np.ndarray:
    """The relative illumination of pictures at the field heights, by `picture_illumination`.

    Returns
    -------
    array (wavelength, height)
    """
    optics = [lens.at_wavelength(nm) for nm in np.atleast_1d(wavelengths_nm)]
    return np.array([picture_illumination(each, FieldGeometry(each, lens.name), each.real_height_mm)
                     for each in optics])


def lateral_colour_um(lens: RadialLens, wavelengths_nm: ArrayLike) -> np.ndarray:
    """Distance of chief rays beyond the chief ray at the reference wavelength.

    Wavelengths beyond the lens data are clipped to its first or last.

    Returns
    -------
    array (wavelength, height), in micrometres
    """
    return 1e3 * (lens.real_height_at(lens.nearest_nm(wavelengths_nm)) - lens.real_height_at(reference_nm(lens)))


def radial_colour_um(lens: RadialLens) -> np.ndarray:
    """Lateral colour along v and u of the PSFs: array (wavelength of WHITE_NM, height, 2)."""
    outwards_um = lateral_colour_um(lens, WHITE_NM)
    return np.stack([outwards_um, np.zeros_like(outwards_um)], axis=-1)


def transfer(psf: np.ndarray, pitch_um: float,
             frequencies_per_mm: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Optical transfer function of PSFs, by direct summation over their samples; its magnitude is the MTF.

    Parameters
    ----------
    psf : array (..., v, u)
        Of unit sum, the chief ray at `[n // 2, n // 2]`.
    pitch_um : float
    frequencies_per_mm : sequence of float
        Cycles per mm in the image.

    Returns
    -------
    tangential, sagittal : complex arrays (..., frequency)
        For gratings that vary along v, with lines along the tangent, and for gratings that vary along u.
    """
    offset_mm = (np.arange(psf.shape[-1]) - psf.shape[-1] // 2) * pitch_um * 1e-3
    waves = np.exp(-2j * np.pi * np.outer(offset_mm, frequencies_per_mm))
    return psf.sum(axis=-1, dtype=np.float64) @ waves, psf.sum(axis=-2, dtype=np.float64) @ waves


def white_mtf(lens: RadialLens, frequencies_per_mm: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """MTF at the field heights in white light, as by `white_contrast`.

    Returns
    -------
    tangential, sagittal : arrays (height, frequency)

    Raises
    ------
    LensError
        The PSFs are sampled too coarsely for a frequency.
    """
    return white_contrast(lens, lens.psf, radial_colour_um(lens), frequencies_per_mm)


def white_contrast(lens: Lens, psf: np.ndarray, moved_um: np.ndarray,
                   frequencies_per_mm: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """MTF in equal-energy white light, weighted by CIE 1931 Y, including lateral colour.

    PSFs are interpolated between the wavelengths of the lens data as in `Lens.at_wavelength`, and constant beyond them.
    Light outside the PSF window and the size of pixels are not taken into account.

    Parameters
    ----------
    lens : Lens
    psf : array (wavelength, place, v, u)
    moved_um : array (wavelength of WHITE_NM, place, 2)
        Lateral colour along v and u.
    frequencies_per_mm : sequence of float
        Cycles per mm in the image.

    Returns
    -------
    along_v, along_u : arrays (place, frequency)
        For gratings that vary along v, and along u.

    Raises
    ------
    LensError
        The PSFs are sampled too coarsely for a frequency.
    """
    finest = finest_frequency_per_mm(lens)
    for frequency in frequencies_per_mm:
        if not 0 < frequency <= finest:
            raise LensError(lens.name, "frequency", f"{frequency:g} cycles/mm", "expected more than 0 and at most "
                            f"{finest:g}, because the PSFs are sampled every {lens.psf_pitch_um:g} um")
    weights = colour_matching(WHITE_NM)[:, 1] / colour_matching(WHITE_NM)[:, 1].sum()
    by_wavelength = weights[:, None] * linear_weights(lens.wavelengths_nm, WHITE_NM)
    moves = np.exp(-2j * np.pi * 1e-3 * moved_um[..., None] * np.asarray(frequencies_per_mm))
    along_v, along_u = (np.abs(np.einsum("nl,npf,lpf->pf", by_wavelength, moves[:, :, axis], part, optimize=True))
                        for axis, part in enumerate(transfer(psf, lens.psf_pitch_um, frequencies_per_mm)))
    return along_v, along_u


def diffraction_cutoff_per_mm(lens: Lens) -> float:
    """Frequency from which the transfer of any lens with this aperture is 0, at the reference wavelength."""
    return 1e6 / (lens.reference_wavelength_nm * lens.f_number_effective)


def airy_radius_um(lens: Lens, wavelength_nm: float) -> float:
    """Radius of the first dark ring of the diffraction pattern: 1.22 times wavelength and f-number."""
    return 1.22e-3 * wavelength_nm * lens.f_number_effective


def finest_frequency_per_mm(lens: Lens) -> float:
    """The finest grating that the PSF samples resolve: half their number per mm."""
    return 500 / lens.psf_pitch_um


def preferred_frequencies_per_mm(lens: Lens) -> list[float]:
    """Three frequencies of the series 1, 2, 5 for this lens, ascending to about a tenth of the diffraction cutoff."""
    finest = min(FINEST_FREQUENCY * diffraction_cutoff_per_mm(lens), finest_frequency_per_mm(lens) / 2)
    last = int(np.argmin(np.abs(np.log(FREQUENCY_SERIES / finest))))
    return FREQUENCY_SERIES[max(0, last + 1 - PREFERRED_FREQUENCIES):last + 1].tolist()
