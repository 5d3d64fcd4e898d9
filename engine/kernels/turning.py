"""PSFs of all heights turned to an azimuth, on the pixel grid."""

from ctypes import Structure, byref
from dataclasses import dataclass

import numpy as np

from .arrays import address
from .declarations import STRUCTURES
from .library import check, chosen

SAMPLES = STRUCTURES["samples"]
EIGHT = 8  # heights that are processed together


@dataclass(frozen=True, eq=False)
class TurnableSamples:
    """The light of PSFs in small squares, laid out for `turn`.

    Attributes
    ----------
    heights : int
    """

    heights: int
    _arrays: tuple[np.ndarray, ...]
    _structure: Structure

    @classmethod
    def of(cls, samples: np.ndarray, v_px: np.ndarray, u_px: np.ndarray, sample_size_px: float) -> "TurnableSamples":
        """From samples (height, sample) at the positions v_px (sample,) outwards and u_px (sample,) tangentially."""
        heights, count = samples.shape
        energy = np.zeros((count, -(-heights // EIGHT) * EIGHT))
        energy[:, :heights] = samples.T
        arrays = np.ascontiguousarray(v_px, dtype=float), np.ascontiguousarray(u_px, dtype=float), energy
        shapes = (count,), (count,), energy.shape
        return cls(heights, arrays, SAMPLES(*(address(array, np.float64, shape) for array, shape in zip(
            arrays, shapes, strict=True)), count, energy.shape[1], sample_size_px))


def turn(samples: TurnableSamples, azimuth_rad: np.ndarray, side_px: int) -> np.ndarray:
    """PSFs at some azimuths, with the chief ray in the middle of an odd square.

    Azimuths are measured from the right upwards.

    Returns
    -------
    float64 array (azimuth, row, column, height)
        A view of an array with room for more heights.

    Raises
    ------
    ValueError
        Light is outside the square.
    """
    loops, variant = chosen()
    turned = np.zeros((len(azimuth_rad), side_px, side_px, samples._arrays[2].shape[1]))
    for psfs, cosine, sine in zip(turned, np.cos(azimuth_rad), np.sin(azimuth_rad), strict=True):
        check(loops.lf_turn(variant, byref(samples._structure), cosine, sine, side_px, psfs.ctypes.data))
    return turned[..., :samples.heights]
