"""Checks the files that a .blend names before Blender opens it, reading their paths from its bytes.

Blender reads libraries at once, and fonts, geometry caches, images of modifiers and files of import nodes as soon as it
evaluates the scene, before `open_mainfile` returns. It would wait forever for a pipe among them.

A .blend consists of a header, blocks, and a description of their structures, `DNA1`:
https://projects.blender.org/blender/blender/src/branch/main/doc/blender_file_format
"""

import gzip
import io
import math
import os
import re
import struct
from dataclasses import dataclass
from pathlib import Path

from lensfield.engine import InputError
from lensfield.engine.runtime.blender_caches import FLUID, OCEAN, POINTS, blend_caches, cache_files
from lensfield.engine.runtime.inputs import (
    MOST_BYTES,
    MOST_FONT_BYTES,
    MOST_TEXT_BYTES,
    check_input,
    check_named,
    is_confined,
    open_input,
)

PATHS = {  # structure: kind of file, the field with its path (older name first), and the largest file size in bytes
    "Library": ("library", ("name", "filepath"), MOST_BYTES), "Image": ("image", ("name", "filepath"), MOST_BYTES),
    "VFont": ("font", ("name", "filepath"), MOST_FONT_BYTES), "bSound": ("sound", ("name", "filepath"), None),
    "MovieClip": ("movie clip", ("name", "filepath"), None), "Volume": ("volume", ("filepath",), None),
    "CacheFile": ("cache", ("filepath",), None), "CacheFileLayer": ("cache", ("filepath",), None),
    "MeshCacheModifierData": ("mesh cache", ("filepath",), None),
    "CustomDataExternal": ("mesh data", ("filename",), None),
    "Camera": ("camera shader", ("custom_filepath",), MOST_TEXT_BYTES),
    "NodeShaderTexIES": ("IES lamp", ("filepath",), MOST_TEXT_BYTES),
    "NodeShaderScript": ("shader script", ("filepath",), MOST_TEXT_BYTES)}
FOLDERS = {  # structure: names of the caches, the field with their folder
    "PointCache": (POINTS, ("path",)), "FluidDomainSettings": (FLUID, ("cache_directory",)),
    "OceanModifierData": (OCEAN, ("cachepath",))}
TEXTS = {"bNodeSocketValueString": ("value",)}  # most are not paths
NODES = {"bNode": ("idname",)}
FIELDS = ({structure: fields for structure, (_, fields, _) in PATHS.items()}
          | {structure: fields for structure, (_, fields) in FOLDERS.items()} | TEXTS | NODES)
GENERATED, EXTERNAL_CACHE = (4, 5), 1 << 9
IN_USE = {
    "Image": ("source", lambda source: source not in GENERATED), "NodeShaderTexIES": ("mode", bool),
    "NodeShaderScript": ("mode", bool), "PointCache": ("flag", lambda flags: flags & EXTERNAL_CACHE),
    "OceanModifierData": ("cached", bool)}
"""structure: a field, and whether its value means that the path is in use. Blender also saves the paths of images that
are now generated, of texts that are now inside the .blend, and of caches that are not external any more."""
IMPORT_NODE = "GeometryNodeImport"
ZSTD, GZIP = b"\x28\xb5\x2f\xfd", b"\x1f\x8b"
DESCRIPTION, END = b"DNA1", b"ENDB"
READ_BYTES = 1 << 20
MOST_BLOCK_BYTES = 1 << 26  # of a description or a data-block: Blender writes 0.1 MB


def check_blend(path: Path) -> None:
    """Raise an InputError if a .blend or one of its libraries is, or names, an unsuitable file such as a pipe.

    Parameters
    ----------
    path : Path
    """
    pending, checked = [Path(path).resolve()], set()
    while pending:
        blend = pending.pop()
        if blend not in checked:
            checked.add(blend)
            pending += _check_one(blend)


def _check_one(blend):
    """Check the files that a .blend names, and return its libraries."""
    libraries, caches = [], blend_caches(blend)
    for structure, text in _paths_in(blend):
        path = _path(text, blend.parent)
        if structure in PATHS:
            kind, _, most_bytes = PATHS[structure]
            check_named(path, kind, blend, most_bytes)
            libraries += [path.resolve()] if kind == "library" and path.is_file() else []
        elif structure in FOLDERS:
            caches += cache_files(path, FOLDERS[structure][0])
        elif structure in TEXTS and _is_special(path):
            check_named(path, "file of a node", blend)
        elif structure in NODES and is_confined() and text.startswith(IMPORT_NODE):
            raise InputError(blend, "node", text, "--untrusted refuses import nodes, because their path may be "
                                                  "computed: apply the modifier")
    for path in caches:
        check_named(path, "cache", blend, None)
    return libraries


def _path(text, folder):
    """A path in a .blend as a path on this system: // is the .blend's folder, and Windows may have written it."""
    if not text.startswith("//"):
        return Path(os.path.normpath(text))
    return Path(os.path.normpath(os.path.join(folder, text[2:] if os.name == "nt" else text[2:].replace("\\", "/"))))


def _is_special(path):
    return path.is_absolute() and os.path.exists(path) and not path.is_file() and not path.is_dir()


def _paths_in(blend):
    """(structure, text) for the paths that a .blend's data-blocks use, and for nodes; raises InputError for damage."""
    check_input(blend, "scene", "expected a .blend file", None)
    try:
        with open_input(blend) as file:
            layouts = _layouts(_Blocks(blend, file))
        with open_input(blend) as file:
            return [(layout.name, text) for number, count, data in _Blocks(blend, file).read(layouts)
                    for layout in (layouts[number],) for one in layout.split(data, count)
                    if layout.uses_file(one) and (text := layout.text(one))]
    except (InputError, OSError):
        raise
    except Exception as error:  # damaged bytes raise a dozen kinds of error, also in decompression
        raise InputError(blend, "scene", "not readable", f"expected a .blend file ({type(error).__name__})") from None


@dataclass(frozen=True)
class _Layout:
    """A structure: its name, size in bytes, and {field: (offset, size)}."""

    name: str
    size: int
    fields: dict

    def split(self, data, count):
        return (data[first:first + self.size] for first in range(0, min(self.size * count, len(data)), self.size))

    def uses_file(self, one):
        """Whether the path is in use: the file is not packed into the .blend, and IN_USE does not rule it out."""
        field, uses = IN_USE.get(self.name, ("", lambda _: True))
        packed = any(any(self.bytes_of(one, name)) for name in ("packedfile", "packedfiles"))
        return not packed and bool(uses(int.from_bytes(self.bytes_of(one, field), "little")))

    def text(self, one):
        raw = next((value for name in FIELDS[self.name] if (value := self.bytes_of(one, name))), b"")
        text = os.fsdecode(raw.partition(b"\0")[0])
        return "" if text.startswith("<") else text  # Blender's built-in font

    def bytes_of(self, one, name):
        offset, size = self.fields.get(name, (0, 0))
        return one[offset:offset + size]


class _Blocks:
    """The blocks of a .blend, in file order.

    Parameters
    ----------
    blend : Path
    file : file of bytes
    """

    def __init__(self, blend, file):
        self._stream = _unpacked(blend, file)
        self._seeks = self._stream is file
        head = self._take(12)
        if not head.startswith(b"BLENDER"):
            raise ValueError("no .blend")
        large = head[7:8] not in b"_-"  # since Blender 5.0
        self.order = "<" if large or head[8:9] == b"v" else ">"
        self.pointer_bytes = 4 if head[7:8] == b"_" else 8
        self._take(int(head[7:9]) - 12 if large else 0)
        self._head = struct.Struct(self.order + ("4siQqq" if large else "4si" + "IQ"[self.pointer_bytes == 8] + "ii"))
        self._large = large

    def read(self, wanted):
        """(structure number, count, bytes) of each block of these structures; for None, of the description's block."""
        while True:
            code, *figures = self._head.unpack(self._take(self._head.size))
            size, number = (figures[2], figures[0]) if self._large else (figures[0], figures[2])
            if code == END:
                return
            if code == DESCRIPTION if wanted is None else number in wanted and code != DESCRIPTION:
                yield number, figures[3], self._take(size)
            else:
                self._skip(size)

    def _take(self, size):
        if not 0 <= size <= MOST_BLOCK_BYTES:
            raise ValueError("a block of that size")
        data = self._stream.read(size)
        if len(data) != size:
            raise EOFError
        return data

    def _skip(self, size):
        if size < 0:
            raise ValueError("a block of that size")
        if self._seeks:
            self._stream.seek(size, os.SEEK_CUR)
            return
        while size:
            size -= len(self._take(min(size, READ_BYTES)))


def _unpacked(blend, file):
    """The bytes of a .blend, which may be compressed."""
    magic = file.read(4)
    file.seek(0)
    if magic.startswith(GZIP):
        return gzip.GzipFile(fileobj=file)
    if magic != ZSTD:
        return file
    try:
        from zstandard import ZstdDecompressor  # included in Blender
    except ImportError:
        raise InputError(blend, "scene", "compressed", 'pip install "lensfield[blender]", or save the file without '
                         "Compress") from None
    return io.BufferedReader(ZstdDecompressor().stream_reader(file, read_across_frames=True), READ_BYTES)


def _layouts(blocks):
    """{number: _Layout} of the structures in FIELDS, from the description of a .blend."""
    _, _, data = next(blocks.read(None))
    parts = _Description(data, blocks.order)
    names, types = parts.texts(b"SDNANAME"), parts.texts(b"TYPE")
    sizes, layouts = parts.sizes(len(types)), {}
    for number in range(parts.count(b"STRC")):
        kind, length = parts.shorts(2)
        fields, offset = {}, 0
        for _ in range(length):
            of_type, name = parts.shorts(2)
            size = _field_bytes(names[name], sizes[of_type], blocks.pointer_bytes)
            fields[re.sub(r"[*()]|\[.*", "", names[name])] = offset, size
            offset += size
        if types[kind] in FIELDS:
            layouts[number] = _Layout(types[kind], sizes[kind], fields)
    return layouts


def _field_bytes(name, type_bytes, pointer_bytes):
    """Size of a field: its name shows whether it is a pointer, an array or a single value."""
    return (pointer_bytes if name[0] in "*(" else type_bytes) * math.prod(map(int, re.findall(r"\[(\d+)\]", name)))


class _Description:
    """Reads `DNA1` from beginning to end: each part is a mark, a count and that many items, aligned to 4 bytes."""

    def __init__(self, data, order):
        self._data, self._at, self._order = data, 0, order

    def texts(self, mark):
        strings = []
        for _ in range(self.count(mark)):
            end = self._data.index(b"\0", self._at)
            strings.append(self._data[self._at:end].decode("ascii"))
            self._at = end + 1
        return strings

    def count(self, mark):
        self._at = -(-self._at // 4) * 4
        self._at = self._data.index(mark, self._at, self._at + 16) + len(mark)
        self._at += 4
        return struct.unpack_from(f"{self._order}i", self._data, self._at - 4)[0]

    def sizes(self, count):
        """The sizes of all types; TLEN does not store their count."""
        self._at = self._data.index(b"TLEN", self._at) + 4
        return self.shorts(count)

    def shorts(self, count):
        self._at += 2 * count
        return struct.unpack_from(f"{self._order}{count}H", self._data, self._at - 2 * count)
