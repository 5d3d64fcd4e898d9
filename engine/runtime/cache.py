"""The cache on disk: files in the user's cache folder, named by a digest of their sources.

The cache is optional. Entries that are missing, damaged or of another version are computed again, and a failed write is
not an error. Files appear complete or not at all, so processes may share the folder. The oldest are removed first.

Each file begins with a seal: a digest of its name and content. A file that was copied from another name is therefore
not valid.
"""

import hashlib
import os
import re
import stat
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from .build_identity import build_identity
from .errors import InputError
from .files import AnyPath, atomic_path
from .inputs import open_input

Value = TypeVar("Value")

NAME = re.compile(r"[0-9a-f]{64}")  # of a file: the digest of its build and key
VARIABLE, OFF = "LENSFIELD_CACHE", "off"
MOST_FILE_BYTES = 2**29
_configured: dict[str, Path] = {}


def set_cache_folder(folder: AnyPath) -> None:
    """Use this folder instead of the user's cache folder. The environment variable LENSFIELD_CACHE takes precedence."""
    _configured["folder"] = Path(folder)


def cache_folder() -> Path | None:
    """The folder that contains a folder for each kind; None if caching is off or the home folder is unknown."""
    setting = os.environ.get(VARIABLE)
    if setting:
        return None if setting.lower() == OFF else Path(setting)
    return _configured.get("folder") or _user_folder()


def is_off() -> bool:
    """Whether the user has switched all caching off, including the caches in memory."""
    return os.environ.get(VARIABLE, "").lower() == OFF


def load(kind: str, key: bytes, read: Callable[[bytes], Value] = bytes) -> Value | None:  # type: ignore[assignment]
    """The cached value of this kind and key; None if it is missing or damaged.

    Parameters
    ----------
    kind : str
    key : bytes
    read : callable
        Returns the value of the content, by default the content itself. Content on which it raises any error counts as
        damaged.
    """
    folder = cache_folder()
    if folder is None:
        return None
    path = _path(folder, kind, key)
    try:
        seal, _, content = _file_bytes(path).partition(b"\n")
        value = read(content) if seal == _seal(path, content) else None
    except Exception:  # also valid seals may be forged, and damage raises a dozen kinds of error
        return None
    with suppress(OSError):  # the file may belong to another user
        os.utime(path)  # marks it as recently used
    return value


def store(kind: str, key: bytes, content: bytes, most_bytes: int) -> None:
    """Cache some content, and limit the size of this kind to `most_bytes`.

    The key identifies everything that the content depends on, except the code: entries of another build of Lensfield
    are never returned.
    """
    folder = cache_folder()
    if folder is None:
        return
    path = _path(folder, kind, key)
    with suppress(OSError, InputError):
        _remove_irregular(path)
        with atomic_path(path, overwrite=True) as temporary:
            temporary.write_bytes(_seal(path, content) + b"\n" + content)
        _remove_oldest(kind, most_bytes)


def size_bytes(kind: str) -> tuple[int, int]:
    """Number of cached entries of a kind, and their bytes."""
    sizes = [status.st_size for _, status in _entries(kind)]
    return len(sizes), sum(sizes)


def clear(kind: str) -> None:
    """Remove all entries of a kind."""
    _remove_oldest(kind, 0)


def _path(folder, kind, key):
    return folder / kind / hashlib.sha256(build_identity().encode() + key).hexdigest()


def _remove_oldest(kind, most_bytes):
    total_bytes = 0
    for path, status in sorted(_entries(kind), key=lambda each: -each[1].st_mtime_ns):
        total_bytes += status.st_size
        if total_bytes > most_bytes:
            with suppress(OSError):  # another process has removed it, or it belongs to another user
                path.unlink()


def _entries(kind):
    """(path, status) of each cached file of a kind; the user's files in the folder are ignored."""
    folder = cache_folder()
    with suppress(OSError):
        for path in folder.joinpath(kind).iterdir() if folder else ():
            if NAME.fullmatch(path.name):
                with suppress(OSError):
                    yield path, path.stat()


def _seal(path, content):
    return hashlib.sha256(path.name.encode() + content).hexdigest().encode()


def _file_bytes(path):
    """The bytes of a file; none for a pipe, a device, and a file larger than any entry."""
    with open_input(path) as file:
        status = os.fstat(file.fileno())
        return file.read() if stat.S_ISREG(status.st_mode) and status.st_size <= MOST_FILE_BYTES else b""


def _remove_irregular(path):
    """Remove a link or pipe in the place of an entry: through a link, another file would be overwritten."""
    with suppress(FileNotFoundError):
        if not stat.S_ISREG(os.lstat(path).st_mode):
            path.unlink()


def _user_folder():
    """A folder in the system's folder for caches; None if the home folder is unknown."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA", "")
    elif sys.platform == "darwin":
        base = os.path.expanduser("~/Library/Caches")
    else:
        base = os.environ.get("XDG_CACHE_HOME", "")
        base = base if os.path.isabs(base) else os.path.expanduser("~/.cache")
    return Path(base, "lensfield") if os.path.isabs(base) else None
