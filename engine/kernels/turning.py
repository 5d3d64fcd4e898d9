"""PSFs of all heights turned to an azimuth, on the pixel grid."""

from ctypes import Structure, byref
from dataclasses import dataclass

import numpy as np

from .library import SAMPLES, address, check, chosen

EIGHT = 8  # heights that go together


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
        """Of samples (height, sample) that lie at v_px (sample,) outwards and u_px (sample,) along the tangent."""
        heights, count = samples.shape
        energy = np.zeros((count, -(-heights // EIGHT) * EIGHT))
        energy[:, :heights] = samples.T
        arrays = np.ascontiguousarray(v_px, dtype=float), np.ascontiguousarray(u_px, dtype=float), energy
        shapes = (count,), (count,), energy.shape
        return cls(heights, arrays, SAMPLES(*(address(array, np.float64, shape) for array, shape in zip(
            arrays, shapes, strict=True)), count, energy.shape[1], sample_size_px))


def turn(samples: TurnableSamples, azimuth_rad: np.ndarray, side_px: int) -> np.ndarray:
    """The PSFs at some azimuths: float64 array (azimuth, row, column, height), the chief ray in the middle of an odd
    square.

    Azimuths count from the right upwards. The array is a view of one that has room for more heights.

    Raises
    ------
    ValueError
        Where light falls outside of the square.
    """
    loops, variant = chosen()
    turned = np.zeros((len(azimuth_rad), side_px, side_px, samples._arrays[2].shape[1]))
    for one, cosine, sine in zip(turned, np.cos(azimuth_rad), np.sin(azimuth_rad), strict=True):
        check(loops.lf_turn(variant, byref(samples._structure), cosine, sine, side_px, one.ctypes.data))
    return turned[..., :samples.heights]
