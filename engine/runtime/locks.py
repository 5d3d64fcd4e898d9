"""Locks that let one process at a time write a file.

The lock is on another file, and the system releases it when the process ends for any reason.
"""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import InputError, explain
from .files import AnyPath, check_target, create_in, hidden_folder, pending, remove

try:
    import fcntl
except ImportError:  # Windows
    import msvcrt

LOCK = ".lock"
HELD_ELSEWHERE = errno.EACCES, errno.EAGAIN, errno.EDEADLK
NO_LOCKS = errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL  # from some network folders
_held: set[Path] = set()


class Busy(InputError):
    """Another process is writing this file."""


@contextmanager
def only_writer(path: AnyPath) -> Iterator[None]:
    """Make this process the only writer of a file for the duration of the block.

    The operating system locks a file in the hidden folder next to it, and releases the lock when the process ends or is
    killed. In a folder without support for locks the block runs without one.

    Raises
    ------
    Busy
        Another process is writing the file, on this machine or on any other that shares the folder.
    """
    check_target(path)
    lock = hidden_folder(Path(path).parent) / f"{Path(path).name}{LOCK}"
    if lock in _held:  # the system would grant the lock to the same process twice
        raise _busy(path)
    handle = _locked(lock, path)
    _held.add(lock)
    try:
        with pending(lock):  # removed while locked: a process that has it open then checks that it still exists
            yield
    finally:
        _held.discard(lock)
        os.close(handle)
        if os.name == "nt":  # Windows does not remove open files, nor one that another process has opened since
            remove(lock)


def _locked(lock, path):
    """A handle of the lock file, locked."""
    flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
    while True:
        try:
            handle = create_in(lock.parent, lambda: os.open(lock, flags, 0o666))
        except OSError as error:
            raise InputError(lock, "file", "not writable", explain(error)) from None
        with suppress(OSError, AttributeError):  # lets other users lock it; fails if it is theirs, and on Windows
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
        os.close(handle)  # its previous holder removed it between opening and locking


def _lock(handle):
    if os.name == "nt":
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
    else:  # `lockf` locks belong to the process: forked workers do not inherit them
        fcntl.lockf(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _busy(path):
    return Busy(path, "file", "being written by another process", "wait for it, or give another folder")
