"""One process at a time makes a file.

Another file is locked meanwhile, and free again however the maker ends.
"""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import InputError
from .files import AnyPath, check_target, hidden_folder, make_folder, pending, remove

try:
    import fcntl
except ImportError:  # Windows
    import msvcrt

LOCK = ".lock"
HELD_ELSEWHERE = errno.EACCES, errno.EAGAIN, errno.EDEADLK
NO_LOCKS = errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL  # such as some network folders
_held: set[Path] = set()


class Busy(InputError):
    """Another process makes this file."""


@contextmanager
def only_maker(path: AnyPath) -> Iterator[None]:
    """Be the only process that makes a file, as long as the block lasts.

    The lock is the system's, on a file in the hidden folder beside: it goes with the process, killed or not. In a
    folder that knows no locks there is none, and the block runs all the same.

    Raises
    ------
    Busy
        Another one makes it, of this machine or of any that shares the folder.
    """
    check_target(path)
    lock = hidden_folder(Path(path).parent) / f"{Path(path).name}{LOCK}"
    if lock in _held:  # the system would let its own process have it twice
        raise _busy(path)
    handle = _locked(lock, path)
    _held.add(lock)
    try:
        with pending(lock):  # it goes while it is held: whoever has opened it looks whether it is still there
            yield
    finally:
        _held.discard(lock)
        os.close(handle)
        if os.name == "nt":  # which removes nothing that is open, nor what another has opened by now
            remove(lock)


def _locked(lock, path):
    """A handle of the lock file, locked."""
    while True:
        make_folder(lock.parent)
        try:
            handle = os.open(lock, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        except FileNotFoundError:  # another one has just removed the folder, which was empty
            continue
        except OSError as error:
            raise InputError(lock, "file", "not writable", error.strerror or str(error)) from None
        with suppress(OSError, AttributeError):  # for others who may write to the folder; it is theirs, or of Windows
            os.fchmod(handle, 0o666)
        try:
            _lock(handle)
            if os.path.samestat(os.fstat(handle), os.stat(lock)):
                return handle
        except OSError as error:
            if error.errno in HELD_ELSEWHERE:
                os.close(handle)
                raise _busy(path) from None
            if error.errno in NO_LOCKS:
                return handle
            if error.errno != errno.ENOENT:
                os.close(handle)
                raise
        os.close(handle)  # it was removed by the one before, between opening and locking


def _lock(handle):
    if os.name == "nt":
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
    else:  # of the process: workers that it has forked do not go on holding it
        fcntl.lockf(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _busy(path):
    return Busy(path, "file", "being made by another process", "wait for that, or give another folder")
