"""Limits for the headers of EXR files, checked before OpenEXR opens them.

OpenEXR's time grows with the square of a part's channels and attributes: a header of 26 MB can take half an hour. So
its bytes are read here first, by OpenEXR's own rules: https://openexr.com/en/latest/OpenEXRFileLayout.html. A header
whose sizes contradict its types is refused: OpenEXR continues in the middle of such an attribute, and could find any
number of channels there.
"""

from ..runtime.errors import ImageError, printable
from ..runtime.files import AnyPath
from ..runtime.inputs import open_input

MAGIC, MULTIPART = (20000630).to_bytes(4, "little"), 0x1000
MOST_BYTES = 2**25
"""The largest headers list the names of all objects for Cryptomatte: 5 MB for 100,000 objects."""
MOST_OF_PART, MOST_ENTRIES = 2**14, 2**16
"""Attributes, channels and texts of a part, and of all parts: OpenEXR reads as many in 0.4 s and 2 s."""
MOST_NAME_BYTES = 255
READ_BYTES = 1 << 16
CHANNEL_BYTES = 16  # behind its name
SIZES = {"box2i": 16, "box2f": 16, "chromaticities": 32, "compression": 1, "deepImageState": 1, "double": 8,
         "envmap": 1, "float": 4, "int": 4, "keycode": 28, "lineOrder": 1, "m33f": 36, "m33d": 72, "m44f": 64,
         "m44d": 128, "rational": 8, "tiledesc": 9, "timecode": 8, "v2i": 8, "v2f": 8, "v2d": 16, "v3i": 12, "v3f": 12,
         "v3d": 24}
"""Bytes of a value, by its type. Types that are not listed have any size."""


def check_header(path: AnyPath) -> None:
    """Check the headers of all parts of an EXR file. A file of another kind passes.

    Raises
    ------
    ImageError
        A header is implausibly large.
    ValueError
        A header is damaged.
    OSError
    """
    with open_input(path) as file:
        header = _Bytes(path, file)
        if header.take(len(MAGIC)) != MAGIC:
            return
        multipart, entries = header.number() & MULTIPART, 0
        while not entries or (multipart and not header.ends()):
            entries += 1 + _entries_of_part(header, path)
            _check_count(path, entries, MOST_ENTRIES)


def _entries_of_part(header, path):
    """The number of attributes, channels and texts of a part."""
    entries, names = 0, set()
    while not header.ends():
        name, kind = header.text(), header.text()
        if name in names:
            raise ValueError(f"the header has two attributes {printable(name)}")
        names.add(name)
        value = header.take(header.number())
        for _ in _pieces(kind, value):
            entries += 1
            _check_count(path, entries, MOST_OF_PART)
    return entries


def _check_count(path, entries, most):
    if entries > most:
        raise ImageError(path, "number of channels and attributes", f"over {most}",
                         "expected an EXR with fewer: save only the layers that you need")


def _pieces(kind, value):
    """The channels or texts in an attribute's value, or the value itself; lazily, because there may be millions.

    Raises
    ------
    ValueError
        The value contradicts its type.
    """
    if kind in LISTS:
        yield from LISTS[kind](value)
    elif len(value) != _size(kind, value):
        raise ValueError(f"an attribute of type {printable(kind)} has {len(value)} bytes")
    else:
        yield value


def _size(kind, value):
    """The bytes that a value of this type has."""
    if kind == "preview":
        return 8 + 4 * _number(value, 0) * _number(value, 4)
    return len(value) // 4 * 4 if kind == "floatvector" else SIZES.get(kind, len(value))


def _channels(value):
    at = 0
    while (end := value.find(b"\0", at, at + MOST_NAME_BYTES + 1)) > at:
        yield value[at:end]
        at = end + 1 + CHANNEL_BYTES
    if end < 0 or end + 1 > len(value):
        raise ValueError("the list of channels is damaged")


def _texts(value):
    at = 0
    while at < len(value):
        length = _number(value, at)
        if at + 4 + length > len(value):
            raise ValueError("a list of texts is damaged")
        yield value[at + 4:at + 4 + length]
        at += 4 + length


def _number(value, at):
    return int.from_bytes(value[at:at + 4], "little")


LISTS = {"chlist": _channels, "stringvector": _texts}


class _Bytes:
    """Reads a file from its beginning, up to MOST_BYTES.

    Parameters
    ----------
    path : path
    file : file of bytes
    """

    def __init__(self, path, file):
        self._path, self._file, self._data, self._at = path, file, bytearray(), 0

    def ends(self):
        """Whether a null byte follows, which is then read."""
        self._fill(self._at + 1)
        ends = self._data[self._at:self._at + 1] == b"\0"
        self._at += ends
        return ends

    def text(self):
        self._fill(self._at + MOST_NAME_BYTES + 1)
        end = self._data.find(b"\0", self._at, self._at + MOST_NAME_BYTES + 1)
        if end <= self._at:
            raise ValueError("the header is damaged")
        self._at, text = end + 1, self._data[self._at:end]
        return text.decode("latin-1")

    def number(self):
        return int.from_bytes(self.take(4), "little", signed=True)

    def take(self, count):
        self._fill(self._at + count)
        data = bytes(self._data[self._at:self._at + max(count, 0)])
        if len(data) != count:
            raise ValueError("the header is damaged or cut off")
        self._at += count
        return data

    def _fill(self, end):
        """Read up to a place in the file, or to its end."""
        if end > MOST_BYTES + MOST_NAME_BYTES:
            raise ImageError(self._path, "header", f"over {MOST_BYTES >> 20} MB",
                             "expected a header without large attributes: save the picture again without them")
        while len(self._data) < end and (block := self._file.read(max(READ_BYTES, end - len(self._data)))):
            self._data += block
