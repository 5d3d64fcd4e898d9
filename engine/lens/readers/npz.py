"""Arrays of a .npz that may come from anybody: what it claims to hold is looked at before anything is read."""

import math
import os
import zipfile
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import numpy as np

PLAIN_KINDS = "biufU"  # truth values, numbers and texts; never objects, which would be pickles
METHODS = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED  # what numpy writes; others take memory of their own
HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
SMALL_BYTES = 2**24
MOST_EXPANSION = 16  # times the file's own bytes: those of lens data are 1 to 3


def read_arrays(source: str | Path | BytesIO, names: Sequence[str] | None = None) -> dict[str, np.ndarray]:
    """Arrays of a .npz by name: those of these that it has, or all.

    Raises
    ------
    ValueError
        An array of another size than its header tells, of objects, or larger than a file of this size can mean; and
        with bytes that are damaged whatever numpy and zipfile raise of them.
    """
    size = source.seek(0, os.SEEK_END) if isinstance(source, BytesIO) else os.path.getsize(source)
    left = SMALL_BYTES + MOST_EXPANSION * size
    arrays = {}
    with zipfile.ZipFile(source) as archive:
        held = archive.NameToInfo
        for name in [member.removesuffix(".npy") for member in held] if names is None else names:
            if member := held.get(f"{name}.npy"):
                left -= _check_member(archive, member, left)
                with archive.open(member) as stream:
                    arrays[name] = np.lib.format.read_array(stream, allow_pickle=False)
    return arrays


def _check_member(archive, member, most_bytes):
    """The bytes of a member's array, by its own header and the archive's; a ValueError where it is not to be read."""
    if member.compress_type not in METHODS:
        raise ValueError(f"{member.filename} is compressed in another way than numpy does")
    with archive.open(member) as stream:
        version = np.lib.format.read_magic(stream)
        if version not in HEADERS:
            raise ValueError(f"{member.filename} is of another version than numpy writes")
        shape, _, kind = HEADERS[version](stream)
        told = math.prod(shape) * kind.itemsize
        if kind.kind not in PLAIN_KINDS or min(shape, default=0) < 0 or told != member.file_size - stream.tell():
            raise ValueError(f"{member.filename} is not as large as it says, or no plain array")
    if told > most_bytes:
        raise ValueError(f"{member.filename} would take {told / 1e6:.0f} MB, far more than its file has")
    return told
