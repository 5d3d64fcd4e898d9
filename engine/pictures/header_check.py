"""Quick check of an existing picture: its header, for programs that have also recorded its size."""

from pathlib import Path

from ..runtime.errors import ImageError
from .spectral_exr import read_parts

SIGNATURES = {".png": b"\x89PNG\r\n\x1a\n", ".dng": b"II*\0"}


def has_header(path: Path) -> bool:
    """Whether an EXR's header is readable, or a PNG or DNG has its signature: after a disk failure a file may be all
    zeros."""
    if signature := SIGNATURES.get(path.suffix.lower()):
        with open(path, "rb") as file:
            return file.read(len(signature)) == signature
    try:
        return bool(read_parts(path, header_only=True))
    except ImageError:
        return False
