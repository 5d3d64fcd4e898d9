"""Arrays that would take too much memory lie in files.

Of these the system holds in memory what it likes. They have no names: each goes with its array, and with the process,
however that ends.
"""

import math
import mmap
import os
import shutil
import tempfile

import numpy as np

from .errors import InputError
from .files import AnyPath, fill, nearest_there
from .memory import available_bytes

MOST = 0.25  # of the memory that is free, that one picture may take
SAMPLE_BYTES = 4


class _Mapped(mmap.mmap):
    folder: AnyPath


def is_large(shape: tuple[int, ...]) -> bool:
    """Whether a float32 array takes so much of the memory that is free, that it had better lie in a file."""
    return SAMPLE_BYTES * math.prod(shape) > MOST * available_bytes()


def folder_if_large(shape: tuple[int, ...], folder: AnyPath | None) -> AnyPath | None:
    """Where an array had better lie that may be in a file in a folder: there, or, None, in memory."""
    return folder if folder is not None and is_large(shape) else None


def check_disk(folder: AnyPath, size_bytes: float) -> None:
    """Raise an InputError where a folder, there already or not yet, has no room for so many bytes of scratch files."""
    try:
        free_bytes = shutil.disk_usage(nearest_there(folder)).free
    except OSError as error:
        raise InputError(folder, "folder", "not to be looked at", error.strerror or str(error)) from None
    if size_bytes > free_bytes:
        raise InputError(folder, "scratch", f"of {size_bytes / 1e9:.3g} GB",
                         f"{free_bytes / 1e9:.3g} GB are free there: give another folder, a smaller picture or fewer "
                         "wavelengths")


def new_array(shape: tuple[int, ...], folder: AnyPath | None) -> np.ndarray:
    """A float32 array of zeros: in memory, or in a file in a folder.

    Raises
    ------
    InputError
        The folder takes no file of that size.
    """
    return np.zeros(shape, np.float32) if folder is None else _in_file(shape, folder)


def beside(array: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A new float32 array of zeros where another one lies: in memory, or in a file in the same folder."""
    mapped = _mapped(array)
    return np.zeros(shape, np.float32) if mapped is None else _in_file(shape, mapped.folder)


def in_file(array: np.ndarray) -> bool:
    """Whether an array lies in a file, and takes no memory but what is to spare."""
    return _mapped(array) is not None


def let_go(array: np.ndarray) -> None:
    """Have the process hold none of an array that lies in a file, until it is used again."""
    mapped = _mapped(array)
    if mapped is not None and hasattr(mmap, "MADV_DONTNEED"):
        mapped.madvise(mmap.MADV_DONTNEED)


def _in_file(shape, folder):
    size_bytes = SAMPLE_BYTES * math.prod(shape)
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            _reserve(file, size_bytes)
            mapped = _Mapped(file.fileno(), size_bytes)
    except (OSError, OverflowError) as error:
        raise InputError(folder, "scratch file", f"not to be made of {size_bytes / 1e9:.3g} GB",
                         getattr(error, "strerror", None) or str(error)) from None
    mapped.folder = folder
    return np.frombuffer(mapped, np.float32).reshape(shape)


def _reserve(file, size_bytes):
    """Take the room on the disk at once: where a mapped file finds none later, the process dies."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.fileno(), 0, size_bytes)
        return
    fill(file, size_bytes)
    file.flush()


def _mapped(array):
    """The file that an array or what it is a part of lies in; None for memory."""
    while isinstance(array, np.ndarray):
        array = array.base
    if isinstance(array, memoryview):
        array = array.obj
    return array if isinstance(array, _Mapped) else None
