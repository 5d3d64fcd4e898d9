"""Arrays too large for memory, stored in scratch files.

The files are memory-mapped, so the system decides how much of them it holds in memory. They are unnamed: each
disappears with its array, or when the process ends for any reason.
"""

import math
import mmap
import os
import shutil
import tempfile

import numpy as np

from .errors import InputError, explain
from .files import AnyPath, fill, nearest_existing
from .memory import available_bytes

MOST = 0.25  # of the free memory, for one picture
SAMPLE_BYTES = 4


class _Mapped(mmap.mmap):
    folder: AnyPath


def is_large(shape: tuple[int, ...]) -> bool:
    """Whether a float32 array exceeds the share of the free memory above which it belongs in a file."""
    return SAMPLE_BYTES * math.prod(shape) > MOST * available_bytes()


def folder_if_large(shape: tuple[int, ...], folder: AnyPath | None) -> AnyPath | None:
    """The folder, if an array is so large that it belongs in a file there; None for memory."""
    return folder if folder is not None and is_large(shape) else None


def check_disk(folder: AnyPath, files: str, size_bytes: float) -> None:
    """Raise an InputError, which names the files, if a folder, existing or not, lacks the disk space for them."""
    try:
        free_bytes = shutil.disk_usage(nearest_existing(folder)).free
    except OSError as error:
        raise InputError(folder, "folder", "not accessible", explain(error)) from None
    if size_bytes > free_bytes:
        raise InputError(folder, files, f"{size_bytes / 1e9:.3g} GB",
                         f"only {free_bytes / 1e9:.3g} GB are free there: give another folder, a smaller picture or "
                         "fewer wavelengths")


def new_array(shape: tuple[int, ...], folder: AnyPath | None) -> np.ndarray:
    """A float32 array of zeros: in memory, or in a file in a folder.

    Raises
    ------
    InputError
        A file of that size cannot be created in the folder.
    """
    return np.zeros(shape, np.float32) if folder is None else _in_file(shape, folder)


def zeros_stored_like(array: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A new float32 array of zeros, stored like another: in memory, or in a file in the same folder."""
    mapped = _mapped(array)
    return np.zeros(shape, np.float32) if mapped is None else _in_file(shape, mapped.folder)


def in_file(array: np.ndarray) -> bool:
    """Whether an array is stored in a file and takes only spare memory."""
    return _mapped(array) is not None


def release_memory(array: np.ndarray) -> None:
    """Release the memory of an array that is stored in a file, until it is used again."""
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
        reason = explain(error) if isinstance(error, OSError) else str(error)
        raise InputError(folder, "scratch file", f"{size_bytes / 1e9:.3g} GB and cannot be created", reason) from None
    mapped.folder = folder
    return np.frombuffer(mapped, np.float32).reshape(shape)


def _reserve(file, size_bytes):
    """Allocate the disk space now: if a mapped file runs out of it later, the process is killed."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.fileno(), 0, size_bytes)
        return
    fill(file, size_bytes)
    file.flush()


def _mapped(array):
    """The mapped file that stores an array or the array that it is a view of; None for memory."""
    while isinstance(array, np.ndarray):
        array = array.base
    if isinstance(array, memoryview):
        array = array.obj
    return array if isinstance(array, _Mapped) else None
