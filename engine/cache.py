"""What is remembered from one process to the next. Files in the user's cache folder, by what they were made from.

Nothing depends on them. What is missing, damaged or of another version is made anew, what cannot be written is not, and
neither is an error. Files appear whole, so that processes may share the folder, and the oldest go first.
"""

import hashlib
import os
import re
import sys
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from .errors import InputError
from .files import AnyPath, atomic_path

NAME = re.compile(r"[0-9a-f]{64}")  # of a file: the digest of what it was made from
VARIABLE, OFF = "LENSFIELD_CACHE", "off"
_given: dict[str, Path] = {}


def keep_in(folder: AnyPath) -> None:
    """Have the files here, in place of the user's cache folder. The environment's LENSFIELD_CACHE still goes first."""
    _given["folder"] = Path(folder)


def cache_folder() -> Path | None:
    """The folder that holds a folder for each kind; None where nothing is to be remembered, or nowhere."""
    asked = os.environ.get(VARIABLE)
    if asked:
        return None if asked.lower() == OFF else Path(asked)
    return _given.get("folder") or _users_own()


def is_off() -> bool:
    """Whether nothing is to be remembered at all, in the process neither."""
    return os.environ.get(VARIABLE, "").lower() == OFF


def recall(kind: str, key: bytes) -> bytes | None:
    """What was remembered of this kind by this key, whole; None where that is not there."""
    folder = cache_folder()
    if folder is None:
        return None
    path = folder / kind / key.hex()
    try:
        seal, _, content = path.read_bytes().partition(b"\n")
    except OSError:
        return None
    with suppress(OSError):  # somebody else's
        os.utime(path)  # it is of use
    return content if seal == _seal(content) else None


def remember(kind: str, key: bytes, content: bytes, most_bytes: int) -> None:
    """Remember some content, and of this kind no more than so many bytes.

    The key is to tell apart all that the content was made from, the version of the code included.
    """
    folder = cache_folder()
    if folder is None:
        return
    with suppress(OSError, InputError):
        with atomic_path(folder / kind / key.hex(), own=True) as temporary:
            temporary.write_bytes(_seal(content) + b"\n" + content)
        _forget_oldest(kind, most_bytes)


def size_bytes(kind: str) -> tuple[int, int]:
    """How many things of a kind are remembered, and their bytes."""
    sizes = [status.st_size for _, status in _remembered(kind)]
    return len(sizes), sum(sizes)


def forget(kind: str) -> None:
    """Forget all of a kind."""
    _forget_oldest(kind, 0)


@lru_cache
def code_version(*rooms: str) -> str:
    """A digest of all files in these rooms of the engine: what those of another version made is not taken for ours."""
    version = hashlib.sha256()
    for room in rooms:
        for path in sorted((Path(__file__).parent / room).rglob("*")):
            if path.suffix in (".py", ".csv", ".osl"):
                version.update(path.read_bytes())
    return version.hexdigest()


def _forget_oldest(kind, most_bytes):
    held = 0
    for path, status in sorted(_remembered(kind), key=lambda each: -each[1].st_mtime_ns):
        held += status.st_size
        if held > most_bytes:
            with suppress(OSError):  # another process has been quicker, or it is somebody else's
                path.unlink()


def _remembered(kind):
    """(path, status) of each file of a kind; others that lie there are somebody's own."""
    folder = cache_folder()
    with suppress(OSError):
        for path in folder.joinpath(kind).iterdir() if folder else ():
            if NAME.fullmatch(path.name):
                with suppress(OSError):
                    yield path, path.stat()


def _seal(content):
    return hashlib.sha256(content).hexdigest().encode()


def _users_own():
    """A folder in the one that the system has for this; None where there is no home."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA", "")
    elif sys.platform == "darwin":
        base = os.path.expanduser("~/Library/Caches")
    else:
        base = os.environ.get("XDG_CACHE_HOME", "")
        base = base if os.path.isabs(base) else os.path.expanduser("~/.cache")
    return Path(base, "lensfield") if os.path.isabs(base) else None
