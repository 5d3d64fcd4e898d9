"""EXR files byte by byte, for headers that OpenEXR does not write."""

import struct

LONG_NAMES, MULTIPART = 0x400, 0x1000
ROWS, COLUMNS = 3, 5
CHANNEL = struct.pack("<iB3xii", 2, 0, 1, 1)  # behind its name: single precision


def attribute(name, kind, value, size=None):
    """An attribute; `size` replaces its true size in bytes."""
    return b"%s\0%s\0%s%s" % (name, kind, struct.pack("<i", len(value) if size is None else size), value)


def channels_attribute(names, name=b"channels"):
    return attribute(name, b"chlist", b"".join(each + b"\0" + CHANNEL for each in names) + b"\0")


def numbered(count, letter=b"c"):
    """Names of channels or attributes, in order."""
    return [b"%s%07d" % (letter, number) for number in range(count)]


def header(names, more=b"", part=b""):
    """The header of a part with these channels and further attributes."""
    box = struct.pack("<4i", 0, 0, COLUMNS - 1, ROWS - 1)
    of_part = attribute(b"name", b"string", part) + attribute(b"type", b"string", b"scanlineimage") + attribute(
        b"chunkCount", b"int", struct.pack("<i", ROWS))
    return b"".join([
        channels_attribute(names), attribute(b"compression", b"compression", b"\0"),
        attribute(b"dataWindow", b"box2i", box), attribute(b"displayWindow", b"box2i", box),
        attribute(b"lineOrder", b"lineOrder", b"\0"), attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1)),
        attribute(b"screenWindowCenter", b"v2f", bytes(8)),
        attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)), of_part if part else b"", more, b"\0"])


def write_black(path, names, more=b""):
    """A black picture with these channels and further attributes."""
    head = struct.pack("<2i", 20000630, 2 | LONG_NAMES) + header(names, more)
    row_bytes = 4 * COLUMNS * len(names)
    return _write(path, head, [struct.pack("<2i", row, row_bytes) + bytes(row_bytes) for row in range(ROWS)])


def write_black_parts(path, count):
    """A file with this many black parts, of one channel each."""
    head = struct.pack("<2i", 20000630, 2 | LONG_NAMES | MULTIPART) + b"".join(
        header([b"Y"], part=part) for part in numbered(count, b"p")) + b"\0"
    return _write(path, head, [struct.pack("<3i", part, row, 4 * COLUMNS) + bytes(4 * COLUMNS)
                               for part in range(count) for row in range(ROWS)])


def _write(path, head, rows):
    """The header, the places of the rows, and the rows."""
    first = len(head) + 8 * len(rows)
    places = [first + number * len(rows[0]) for number in range(len(rows))]
    path.write_bytes(head + struct.pack(f"<{len(rows)}Q", *places) + b"".join(rows))
    return path
