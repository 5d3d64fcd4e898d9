"""Arrays from an untrusted .npz: its headers are checked before any array is read."""

import math
import os
import zipfile
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np

SAFE_KINDS = "biufU"  # booleans, numbers and strings; never objects, which would be pickles
METHODS = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED  # the methods that numpy writes; others need more memory
HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
SMALL_BYTES = 2**24
MOST_EXPANSION = 16  # times the file's bytes: lens data expand by a factor of 1 to 3


def read_arrays(source: str | Path | BytesIO, names: Sequence[str] | None = None) -> dict[str, np.ndarray]:
    """Arrays of a .npz by name: all, or the given names that it contains.

    Raises
    ------
    ValueError
        The size of an array differs from its header, it consists of objects, or it is implausibly large for the size of
        the file. Damaged bytes also raise other exceptions, from numpy and zipfile.
    """
    size = source.seek(0, os.SEEK_END) if isinstance(source, BytesIO) else os.path.getsize(source)
    left = SMALL_BYTES + MOST_EXPANSION * size
    arrays = {}
    with zipfile.ZipFile(source) as archive:
        members = archive.NameToInfo
        for name in [member.removesuffix(".npy") for member in members] if names is None else names:
            if member := members.get(f"{name}.npy"):
                left -= _check_member(archive, member, left)
                with archive.open(member) as stream:
                    arrays[name] = np.lib.format.read_array(stream, allow_pickle=False)
    return arrays


def _check_member(archive, member, most_bytes):
    """The bytes of a member's array, according to both headers; raise a ValueError for an unsafe or damaged member."""
    if member.compress_type not in METHODS:
        raise ValueError(f"{member.filename} is compressed by a method that numpy does not use")
    with archive.open(member) as stream:
        version = np.lib.format.read_magic(stream)
        if version not in HEADERS:
            raise ValueError(f"{member.filename} has a version that numpy does not write")
        shape, _, kind = HEADERS[version](stream)
        size_bytes = math.prod(shape) * kind.itemsize
        if kind.kind not in SAFE_KINDS or min(shape, default=0) < 0 or size_bytes != member.file_size - stream.tell():
            raise ValueError(f"{member.filename} is not as large as its header states, or contains objects")
    if size_bytes > most_bytes:
        raise ValueError(f"{member.filename} would take {size_bytes / 1e6:.0f} MB, far more than its file contains")
    return size_bytes
