"""Cryptomatte 1.2: ids of names as numbers in pictures, and the attributes that list the names.

Friedman and Jones, *Fully automatic ID mattes with support for motion blur and transparency* (SIGGRAPH 2015), and the
specification of 2018 (github.com/Psyop/Cryptomatte). A name's id is its MurmurHash3, x86, 32 bits, seed 0, as the bits
of a number in single precision that is neither denormal, infinite nor NaN.
"""

import json
from collections.abc import Iterable, Mapping

import numpy as np

ROTATED, MASK = (0xCC9E2D51, 15, 0x1B873593), 0xFFFFFFFF
KEY_LETTERS = 7  # of the hash of a layer's name


def hash_of(name: str) -> int:
    """The hash of a name, before its conversion to a number."""
    data = name.encode()
    value, blocks_end = 0, len(data) // 4 * 4
    for begin in range(0, blocks_end, 4):
        value ^= _mixed(int.from_bytes(data[begin:begin + 4], "little"))
        value = (_rotated(value, 13) * 5 + 0xE6546B64) & MASK
    value ^= _mixed(int.from_bytes(data[blocks_end:], "little")) ^ len(data)
    value = ((value ^ value >> 16) * 0x85EBCA6B) & MASK
    value = ((value ^ value >> 13) * 0xC2B2AE35) & MASK
    return value ^ value >> 16


def _mixed(block):
    first, turn, second = ROTATED
    return (_rotated(block * first & MASK, turn) * second) & MASK


def _rotated(value, bits):
    return (value << bits | value >> 32 - bits) & MASK


def id_of(name: str) -> np.float32:
    """The number of a name in pictures."""
    value = hash_of(name)
    if value >> 23 & 255 in (0, 255):  # the exponent of denormal, infinite and invalid numbers
        value ^= 1 << 23
    return np.uint32(value).view(np.float32)


def renamed(ids: np.ndarray, names: Mapping[str, str]) -> np.ndarray:
    """A plane of ids, with the ids of some names replaced by the ids of others: float32 array (row, column)."""
    if not names:
        return ids
    before, after = (np.array([id_of(name) for name in side]).view(np.uint32) for side in (names, names.values()))
    order = np.argsort(before)
    bits = np.ascontiguousarray(ids, np.float32).view(np.uint32)
    place = order[np.minimum(np.searchsorted(before, bits, sorter=order), len(order) - 1)]
    return np.where(before[place] == bits, after[place], bits).view(np.float32)


def attributes_of(layer: str, names: Iterable[str]) -> dict[str, str]:
    """Attributes of a file's header for a Cryptomatte layer, such as ViewLayer.CryptoObject, with these names in it."""
    key = f"cryptomatte/{hash_of(layer):08x}"[:len("cryptomatte/") + KEY_LETTERS]
    manifest = {name: f"{id_of(name).view(np.uint32):08x}" for name in sorted(set(names))}
    facts = {"name": layer, "hash": "MurmurHash3_32", "conversion": "uint32_to_float32",
             "manifest": json.dumps(manifest, ensure_ascii=False, separators=(",", ":"))}
    return {f"{key}/{field}": text for field, text in facts.items()}
