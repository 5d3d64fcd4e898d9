"""Even samples of the stop."""

import numpy as np


def stop_places(count: int, seed: int) -> np.ndarray:
    """Places of the stop, each for as much of its area: array (2, count), in semi-apertures.

    Sobol's sequence with Owen's scrambling, by a hash (Burley, JCGT 9(4), 2020).
    """
    index = np.arange(count, dtype=np.uint32)
    first, second = _reversed(index), np.zeros_like(index)
    direction = 1 << 31
    for bit in range(count.bit_length()):
        second ^= np.where(index >> bit & 1, np.uint32(direction), np.uint32(0))
        direction ^= direction >> 1
    across, around = (_scrambled(bits, 2 * seed + axis) / 2.0**32 for axis, bits in enumerate((first, second)))
    radius, azimuth = np.sqrt(across), 2 * np.pi * around
    places = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)])
    ends = [0, *(2**n for n in range(5, count.bit_length()))]
    return np.concatenate([_gathered(places[:, first:end]) for first, end in zip(ends, ends[1:], strict=False)], axis=1)


def _gathered(places):
    """Places in an order in which those of an eight lie side by side: such rays mostly meet the same layers."""
    count = places.shape[1]
    if count <= 8:
        return places
    places = places[:, np.argsort(places[np.argmax(np.ptp(places, axis=1))], kind="stable")]
    return np.concatenate([_gathered(places[:, :count // 2]), _gathered(places[:, count // 2:])], axis=1)


def _reversed(bits):
    for shift, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF), (16, 0x0000FFFF)):
        mask = np.uint32(mask)
        bits = (bits >> np.uint32(shift)) & mask | (bits & mask) << np.uint32(shift)
    return bits


def _scrambled(bits, seed):
    bits = _reversed(bits) + np.uint32((seed + 1) * 0x9E3779B9 & 0xFFFFFFFF)
    for factor in (0x6C50B47C, 0xB82F1E52, 0xC7AFE638, 0x8D22F6E6):
        bits ^= bits * np.uint32(factor)
    return _reversed(bits)
