"""Whether a picture that is there can be what was written: its header, for programs that have noted its size."""

from pathlib import Path

from ..errors import ImageError
from .spectral_exr import read_parts

PNG = b"\x89PNG\r\n\x1a\n"


def has_header(path: Path) -> bool:
    """Whether an EXR's header can be read, or a PNG begins as one; zeros are what a lost disk leaves of a file."""
    if path.suffix.lower() == ".png":
        with open(path, "rb") as file:
            return file.read(len(PNG)) == PNG
    try:
        return bool(read_parts(path, header_only=True))
    except ImageError:
        return False
