"""Random damage of files: in their bytes, in their words, and in the structure of packages."""

import io
import json
import re
import struct
import zipfile

import numpy as np

SHARDS = [
    b"0", b"-1", b"1e400", b"1e-320", b"nan", b"inf", b"9" * 400, b"9" * 10**5, b"0x" + b"f" * 10**4, b"true", b"null",
    b'"', b"'", b"[", b"]" * 50, b"{", b";", b"&", b"*", b"#", b"!", b"%", b"=", b":", b".", b",", b"~x/", b"\n", b"\r",
    b"\0", b"\t" * 1000, b"\x1b]0;owned\x07", b"\xff\xfe", b"\xef\xbb\xbf", b"\xc3", "½\u202e".encode(), b"[" * 10**5,
    b'{"a":' * 10**4, b"a." * 2000 + b"a", b"- " * 5000, b"(" * 5000, b"-" * 5000, b"../", b"C:\\", b"%s%n",
    b"{height}" * 99, b"STOP", b"SURF", b"radius_mm"]
EXTREMES = [0, 1, 0xff, 0x7f, 0xffff, 0x7fff, 0x7fffffff, 0xffffffff, 0x80000000, 2**24, 10**4, 10**9]
JSON_VALUES = [None, True, 0, -1, 10**400, 1e308, float("nan"), float("inf"), "", "x" * 10**5, "\x1b[31m", [], [1], {},
               {"a": 1}, [[[[[]]]]], ["1"], "1.5"]
SHAPES = [(), (0,), (-1,), (1,), (2**40,), (2**20, 2**20), (10**4,) * 4, (3,) * 32]
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")


def damaged(data, random):
    """The bytes with one to three random changes."""
    for _ in range(random.integers(1, 4)):
        data = HURTS[random.integers(len(HURTS))](data, random)
    return data


def _at(data, random):
    return int(random.integers(len(data) + 1))


def _pick(choices, random):
    return choices[random.integers(len(choices))]


def _cut_off(data, random):
    return data[:_at(data, random)]


def _flipped(data, random):
    at = _at(data, random)
    return data[:at] + random.bytes(1) + data[at + 1:]


def _lost(data, random):
    at = _at(data, random)
    return data[:at] + data[at + int(random.integers(1, 40)):]


def _blotted(data, random):
    at, size = _at(data, random), int(random.integers(1, 40))
    return data[:at] + random.bytes(size) + data[at + size:]


def _inserted(data, random):
    at = _at(data, random)
    return data[:at] + _pick(SHARDS, random) + data[at:]


def _word_replaced(data, random):
    words = re.split(rb"([\s=,:\[\]{}]+)", data)
    at = 2 * int(random.integers(len(words) // 2 + 1))
    return b"".join([*words[:at], _pick(SHARDS, random), *words[at + 1:]])


def _number_replaced(data, random):
    matches = list(NUMBER.finditer(data))
    if not matches:
        return data
    match = matches[random.integers(len(matches))]
    return data[:match.start()] + _pick(SHARDS[:10] + [b"1e5", b"100000", b"1e9", b"-3"], random) + data[match.end():]


def _doubled(data, random):
    first, last = sorted((_at(data, random), _at(data, random)))
    last = min(last, first + 4000)
    return data[:last] + data[first:last] * int(_pick([1, 3, 200], random)) + data[last:]


def _line_moved(data, random):
    lines = data.split(b"\n")
    line = lines.pop(int(random.integers(len(lines))))
    lines.insert(int(random.integers(len(lines) + 1)), line)
    return b"\n".join(lines)


def _integer_replaced(data, random):
    at, kind = _at(data, random), _pick(["<I", ">I", "<H", "<Q"], random)
    value = _pick(EXTREMES, random) % 2**(8 * struct.calcsize(kind))
    return data[:at] + struct.pack(kind, value) + data[at + struct.calcsize(kind):]


HURTS = [_cut_off, _flipped, _lost, _blotted, _inserted, _word_replaced, _number_replaced, _doubled, _line_moved,
         _integer_replaced]


# Lens packages

def damaged_package(data, random):
    """A package damaged at one of four levels: its bytes, the archive, an array's bytes or contents, the header's JSON.
    """
    return [damaged, _archive_hurt, _array_hurt, _header_hurt][random.integers(4)](data, random)


def members_of(data):
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def packed(members, compression=zipfile.ZIP_DEFLATED):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", compression) as archive:
        for name, contents in members.items():
            archive.writestr(name, contents)
    return stream.getvalue()


def _archive_hurt(data, random):
    """Remove, add, rename or overwrite members, falsify the directory, or change the compression."""
    members, kind = members_of(data), int(random.integers(6))
    name = _pick(list(members), random)
    if kind == 0:
        del members[name]
    elif kind == 1:
        members[_pick(["junk.npy", "../x.npy", "\x1b[31m.npy", "x" * 5000, "header", "pickle.npy"], random)] = (
            bytes(2**24) if random.random() < 0.2 else random.bytes(99))
    elif kind == 2:
        members[f"{name}x"] = members.pop(name)
    elif kind == 3:
        return packed(members, _pick([zipfile.ZIP_STORED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA], random))
    elif kind == 4:
        members[name] = members[_pick(list(members), random)]
    data = packed(members)
    return data if kind < 5 else _directory_hurt(data, random)


def _directory_hurt(data, random):
    """Change a field of a record, in the directory or before a member's bytes: flags, method, sums, sizes, offsets."""
    places = [match.start() for match in re.finditer(b"PK\x01\x02|PK\x03\x04|PK\x05\x06", data)]
    at = _pick(places, random) + int(random.integers(4, 46))
    return data[:at] + struct.pack("<I", _pick(EXTREMES, random)) + data[at + 4:]


def _array_hurt(data, random):
    """Give a member other bytes, another header (possibly false) or another array."""
    members = members_of(data)
    name = _pick(list(members), random)
    array = np.load(io.BytesIO(members[name]))
    kind = int(random.integers(3))
    if kind == 0:
        members[name] = damaged(members[name], random)
    elif kind == 1:
        header = {"descr": _pick(["<f8", "<u2", "|O", "<U9", "<c16", "|V8", [("a", "<f8")], "<M8[s]", "|b1"], random),
                  "fortran_order": bool(random.integers(2)), "shape": _pick([*SHAPES, array.shape[::-1]], random)}
        text = _pick([repr(header), "(" * 5000, "{" * 5000, "-" * 5000 + "1", "{'descr': '<f8'}"], random).encode()
        members[name] = b"\x93NUMPY\1\0" + struct.pack("<H", len(text) % 2**16) + text + members[name][128:]
    else:
        members[name] = npy(_other_array(array, random))
    return packed(members)


def _other_array(array, random):
    """Change an array's numbers, type or shape, or replace it by an enormous array."""
    if array.dtype.kind == "U":
        return _pick([np.array(1.0), np.array(["{}", "{}"]), np.array("["), np.zeros(3)], random)
    changed = array.astype(float)
    if changed.size:
        changed.flat[random.integers(changed.size)] = _pick([np.nan, np.inf, -1, 0, 1e308, -1e-320], random)
    with np.errstate(invalid="ignore"):
        as_before = changed.astype(array.dtype, casting="unsafe")
    return _pick([changed, as_before, array[..., :0], array[None], array.ravel(), array.T, np.zeros_like(array),
                  np.full_like(array, 1), array.astype("U8"), array.astype(bool), array.astype(">f8"),
                  np.broadcast_to(array.ravel()[:1], (6, 3000, 1000))], random)


def npy(array):
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=False)
    return stream.getvalue()


def _header_hurt(data, random):
    """Change the types of fields in the header's JSON, remove fields, or damage the text."""
    members = members_of(data)
    text = np.load(io.BytesIO(members["header.npy"])).item()
    header = json.loads(text)
    field, kind = _pick(list(header), random), int(random.integers(4))
    if kind == 0:
        text = damaged(text.encode(), random).decode("utf-8", "replace").replace("\0", " ")
    elif kind == 1:
        text = text.replace(f'"{field}": ', f'"{field}": ' + "[" * int(_pick([10, 10**3, 10**5], random)))
    else:
        changed = {name: value for name, value in header.items() if name != field or kind == 2}
        text = json.dumps(changed | ({field: _pick(JSON_VALUES, random)} if kind == 2 else {}))
    return packed(members | {"header.npy": npy(np.array(text))})
