"""Quick check of an existing picture: its header, for programs that have also recorded its size."""

from pathlib import Path

from ..runtime.errors import ImageError
from .spectral_exr import read_parts

PNG = b"\x89PNG\r\n\x1a\n"


def has_header(path: Path) -> bool:
    """Whether an EXR's header is readable, or a PNG has its signature: after a disk failure a file may be all zeros."""
    if path.suffix.lower() == ".png":
        with open(path, "rb") as file:
            return file.read(len(PNG)) == PNG
    try:
        return bool(read_parts(path, header_only=True))
    except ImageError:
        return False
