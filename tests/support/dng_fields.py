"""The fields of little-endian TIFF and DNG files, read without the code that writes them."""

import struct

import numpy as np

EXIF = 34665
KINDS = {1: (1, None), 2: (1, None), 3: (2, "u2"), 4: (4, "u4"), 5: (8, "u4"), 7: (1, None), 10: (8, "i4"),
         12: (8, "f8")}  # of TIFF's fields: bytes, and the type in numpy


def fields(path):
    """Two dictionaries of values by code: of a little-endian TIFF's first directory, and of its EXIF directory."""
    data = path.read_bytes()
    assert data[:4] == b"II*\0"
    tags = directory(data, struct.unpack_from("<I", data, 4)[0])
    return tags, directory(data, int(tags[EXIF]))


def directory(data, place):
    return dict(field(data, place + 2 + 12 * index) for index in range(struct.unpack_from("<H", data, place)[0]))


def field(data, place):
    code, kind, count = struct.unpack_from("<2HI", data, place)
    size, letter = KINDS[kind]
    if size * count > 4:
        place = struct.unpack_from("<I", data, place + 8)[0] - 8
    raw = data[place + 8:place + 8 + size * count]
    if letter is None:
        return code, raw.rstrip(b"\0").decode() if kind == 2 else raw
    values = np.frombuffer(raw, f"<{letter}").astype(float)
    if kind in (5, 10):
        values = values[::2] / values[1::2]
    return code, values[0] if values.size == 1 else values
