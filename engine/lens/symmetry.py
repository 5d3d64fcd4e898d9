"""Symmetry of the PSFs of rotationally symmetric lenses: about the meridional plane, and on the axis of rotation."""

import numpy as np

SYMMETRY_TOLERANCE = 1e-2
"""Largest L1 distance between a PSF and its mirror image that counts as noise. Half a sample off centre is about 20
times as much."""


def mirror_symmetric(psf: np.ndarray) -> tuple[np.ndarray, bool]:
    """PSFs made exactly mirror-symmetric in u, if they are so except for numerical noise.

    Parameters
    ----------
    psf : array (height, v, u), the chief ray at n // 2

    Returns
    -------
    psf : array (height, v, u), unchanged, or averaged with its mirror image and then of odd size
    symmetric : bool
    """
    if not is_mirror_symmetric(psf):
        return psf, False
    even = 1 - psf.shape[-1] % 2
    odd = np.pad(psf, ((0, 0), (0, even), (0, even))) if even else psf  # gives -n/2 a partner
    return (odd + odd[..., ::-1]) / 2, True


def is_mirror_symmetric(psf: np.ndarray) -> bool:
    """Whether PSFs (height, v, u), the chief ray at n // 2, are mirror-symmetric in u except for noise."""
    even = 1 - psf.shape[-1] % 2
    right = psf[..., psf.shape[-1] // 2 + 1:]
    left = psf[..., even:even + right.shape[-1]][..., ::-1]
    unpaired = psf[..., :even].sum(axis=(-2, -1))  # column -n/2 of an even size, which must be dark
    return bool((2 * np.abs(right - left).sum(axis=(-2, -1)) + 2 * unpaired).max() <= SYMMETRY_TOLERANCE)


def is_rotation_symmetric(psf: np.ndarray) -> bool:
    """Whether a PSF (v, u) of odd size, the chief ray in the middle, equals its quarter turn except for noise."""
    return bool(np.abs(psf - np.rot90(psf)).sum() <= SYMMETRY_TOLERANCE)
