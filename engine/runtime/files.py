"""Files appear complete or not at all.

They are written under temporary names that contain their process, flushed to the disk, and renamed. If that fails, the
error has the file's final name and the system's reason. Temporary files of killed processes are removed by the next
process that writes to the folder, and at the end of an animation.
"""

import errno
import hashlib
import os
import platform
import re
import shutil
import stat
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import IO, TypeVar

from .build_identity import MARK
from .errors import InputError, explain
from .inputs import check_writable_place

AnyPath = str | os.PathLike[str]
Created = TypeVar("Created")

MARKS = MARK.lower().encode(), b"psf_amplitude.npy", b"seconds_over_paper"  # an array of packages, a column of tables
HEAD_BYTES, LONGEST_HEAD_BYTES = 1 << 16, 1 << 20  # a header of 10,000 channels is shorter than the second
HALF = ".lensfield-half-written-"
HIDDEN = ".lensfield"
WORK, OF_BLENDER = "lensfield-work-", "blender_*"
OWNER = re.compile(r"([0-9a-f]{8})-(\d+)-")  # follows the prefixes HALF and WORK: the machine and its process
LONGEST_WRITE_S = 24 * 3600.0
PROBE_BYTES = 1 << 20
ATTEMPTS = 100  # each fails only if another process removes a folder at that very moment
UMASK = os.umask(0)  # reading it requires setting it, which is not thread-safe; hence on import
os.umask(UMASK)
_pending: set[Path] = set()
_creating = threading.Lock()  # held while a temporary file is created and entered in _pending
_swept: set[AnyPath] = set()
_resumable: set[Path] = set()


def make_folder(path: AnyPath) -> None:
    """Create a folder and its parents; raise an InputError if that fails."""
    try:
        _repeat(lambda: Path(path).mkdir(parents=True, exist_ok=True))
    except (OSError, ValueError) as error:
        raise InputError(path, "folder", "impossible to create", explain(error)) from None


def create_in(folder: AnyPath, create: Callable[[], Created]) -> Created:
    """Create something in a folder, and the folder if necessary.

    Other processes may remove the folder whenever it is empty, as `remove` does: then both are created again.

    Parameters
    ----------
    folder : path
    create : function
        Creates a file or folder in it, and is called again if the folder has disappeared.

    Returns
    -------
    object
        The result of `create`.

    Raises
    ------
    InputError
        The folder cannot be created.
    OSError
        From `create`.
    """
    def attempt():
        make_folder(folder)
        return create()

    return _repeat(attempt)


def _repeat(attempt):
    """The result of a function that fails if another process removes a folder amid it: then it is called again.

    `Path.mkdir` reports such a folder as existing if it disappears before its `is_dir`. The same errors are permanent
    if a file is in the way, or in a file system that creates no folders; hence the limit.
    """
    for _ in range(ATTEMPTS - 1):
        with suppress(FileExistsError, FileNotFoundError):
            return attempt()
    return attempt()


def nearest_existing(path: AnyPath) -> Path:
    """The path, or its nearest parent that exists."""
    return next(place for place in (Path(path), *Path(path).absolute().parents) if os.path.exists(place))


def hidden_folder(folder: AnyPath) -> Path:
    """The hidden folder in an output folder, for temporary files. It may not exist; `remove` removes it if it is empty.

    Raises
    ------
    InputError
        It is a link, as an untrusted folder may contain: files anywhere could be removed and overwritten through it.
    """
    hidden = Path(folder).resolve() / HIDDEN
    if hidden.is_symlink():
        raise InputError(hidden, "folder", "a link", "remove it")
    return hidden


def check_target(path: AnyPath, overwrite: bool = False) -> None:
    """Raise an InputError if a file cannot or should not be written, before the work on its contents begins.

    Parameters
    ----------
    path : path
    overwrite : bool
        Whether to overwrite any existing file, for folders that contain only Lensfield's files. By default an existing
        file must have been written by Lensfield: the user's files are never overwritten.
    """
    named, (path, mode) = path, _resolved(path)
    check_writable_place(path)
    if stat.S_ISDIR(mode):
        raise InputError(named, "file", "a folder", "give the name of a file to write")
    if not stat.S_ISREG(mode):
        raise InputError(named, "file", "a device or pipe", "give the name of a file to write")
    if not overwrite:
        check_written_by_lensfield(named)
    folder = path.parent
    try:
        with _creating:
            handle, probe = create_in(folder, lambda: tempfile.mkstemp(prefix=HALF, dir=folder))
            os.close(handle)
            os.unlink(probe)
    except OSError as error:
        raise InputError(path, "file", "not writable", explain(error)) from None


def _resolved(path: AnyPath) -> tuple[Path, int]:
    """The path with links resolved, and the mode of the file there; a regular file's mode if nothing exists yet."""
    try:
        target = Path(path).resolve()
        return target, target.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):  # the latter is reported when its folder is created
        return target, stat.S_IFREG
    except RuntimeError:  # from `resolve`, for circular links
        error = OSError(errno.ELOOP, os.strerror(errno.ELOOP))
        raise InputError(path, "file", "not accessible", explain(error)) from None
    except (OSError, ValueError) as error:
        raise InputError(path, "file", "not accessible", explain(error)) from None


def check_written_by_lensfield(path: AnyPath) -> None:
    """Raise an InputError for an existing file that belongs to the user: Lensfield did not write it."""
    if not _is_ours(path):
        raise InputError(path, "file", "an existing file that Lensfield did not write",
                         "move it, or give another name or folder")


def _is_ours(path):
    """Whether Lensfield wrote a file, or its loss is harmless: it is missing, empty or all zeros."""
    try:
        with open(path, "rb") as file:
            head = file.read(HEAD_BYTES)  # short, because there may be many frames on a network disk
            if not _is_marked(head):
                head += file.read(LONGEST_HEAD_BYTES)
    except (FileNotFoundError, NotADirectoryError):
        return True
    except OSError:  # not readable, so it belongs to another user
        return False
    return _is_marked(head) or not head.strip(b"\0")


def _is_marked(head):
    head = head.lower()
    return any(mark in head for mark in MARKS)


def identity(path: AnyPath) -> tuple[int, int] | tuple[int, int, str]:
    """A key that is equal for all names of one file, existing or not, whose file system may ignore case."""
    path = Path(path).resolve()
    try:
        status = path.stat()
    except OSError:
        folder = path.parent.stat()
        return folder.st_dev, folder.st_ino, path.name.casefold()
    return status.st_dev, status.st_ino


@contextmanager
def atomic_path(path: AnyPath, overwrite: bool = False) -> Iterator[Path]:
    """A temporary path next to `path`. It replaces `path` if the block succeeds, and is removed if the block fails.

    `overwrite` is as for `check_target`. An existing file's permissions remain.

    Raises
    ------
    InputError
        The system reports an error in the block or while the file is flushed, such as a full disk.
    """
    check_target(path, overwrite)
    named, path = path, Path(path).resolve()  # a link stays, and its target is replaced
    status = file_status(path)
    mode = stat.S_IMODE(status.st_mode) & 0o777 if status else 0o666 & ~UMASK  # mkstemp gives access to the owner alone
    try:
        with _pending_path(lambda: create_in(path.parent, lambda: _half_written(path))) as temporary:
            if path.parent not in _swept:
                _swept.add(path.parent)
                _remove_half_written(path.parent, temporary.stat().st_mtime)
            yield temporary
            _flush(temporary)
            if temporary.stat().st_nlink == 1:  # a link to another file has its permissions
                os.chmod(temporary, mode)
            os.replace(temporary, path)
            _flush_folder(path.parent)
    except OSError as error:
        raise InputError(named, "file", "not written", explain(error)) from None


def matching(folder: Path, pattern: str) -> list[Path]:
    """The sorted paths in a folder that match a glob pattern; none if another process removes the folder meanwhile."""
    with suppress(OSError):
        return sorted(folder.glob(pattern))
    return []


def link_or_copy(source: AnyPath, path: AnyPath) -> None:
    """Create a hard link to a file, which survives the file's removal; or copy the file if that is impossible."""
    with suppress(FileNotFoundError):  # the copy does not exist, or another process has just removed it
        if os.path.samefile(source, path):
            return
    with atomic_path(path) as temporary:
        try:
            temporary.unlink()
            os.link(source, temporary)
        except OSError:  # another disk, or one without hard links
            shutil.copyfile(source, temporary)


def stamp_of(path: AnyPath) -> tuple[int, int, int] | None:
    """A stamp that changes if a file is rewritten, or if a folder gains or loses a file; None for a missing path."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):  # the latter for a text that is not a valid path
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def file_status(path: AnyPath) -> os.stat_result | None:
    """The status of a regular file; None for anything else, and for a path that cannot exist."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    return status if stat.S_ISREG(status.st_mode) else None


def move(source: AnyPath, path: AnyPath) -> None:
    """Move a file to a Lensfield folder, even from another disk. It appears complete or not at all."""
    with atomic_path(path, overwrite=True) as temporary:
        try:
            os.replace(source, temporary)
        except OSError:
            shutil.copyfile(source, temporary)
            os.unlink(source)


def fill(file: IO[bytes], size_bytes: int) -> None:
    """Write zeros."""
    for written in range(0, size_bytes, PROBE_BYTES):
        file.write(bytes(min(PROBE_BYTES, size_bytes - written)))


def why_no_room(folder: AnyPath, size_bytes: int) -> str:
    """The reason why a file of this size cannot be written to a folder, determined by trying; "" if it can."""
    try:
        with _pending_path(lambda: _half_written(Path(folder, "room"))) as probe, open(probe, "wb") as file:
            fill(file, size_bytes)
    except OSError as error:
        return explain(error)
    return ""


def _half_written(path):
    prefix, suffix = f"{HALF}{_owner()}{path.stem[:40]}-", path.suffix[:20]  # within the file system's limit for names
    handle, name = tempfile.mkstemp(prefix=prefix, suffix=suffix, dir=path.parent)
    os.close(handle)
    return Path(name)


def _flush(path):
    """Flush a file to the disk: some file systems report only now that the disk is full."""
    with open(path, "rb+") as file:
        os.fsync(file.fileno())


def _flush_folder(folder):
    """Flush a folder's names to the disk, on systems that support it."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _owner():
    return f"{_machine()}-{os.getpid()}-"


@cache
def _machine():
    """An identifier of this machine among all that write to the same disk. Each container counts as a machine."""
    process_namespace = ""
    with suppress(OSError):  # exists only on Linux
        process_namespace = os.readlink("/proc/self/ns/pid")
    return hashlib.sha256(f"{platform.node()} {process_namespace}".encode()).hexdigest()[:8]


def is_at_work(process: int) -> bool:
    """Whether a process of this machine runs. On Windows, which does not report it, always True."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # another user's
        return True
    return True


def remove_half_written(folder: AnyPath) -> None:
    """Remove temporary files of killed processes from a folder.

    Files of this machine's processes are removed at once. Other machines' processes may still run, so their files are
    removed by age alone, on the clock that stamps the folder's files.
    """
    with suppress(OSError), _pending_path(lambda: _half_written(Path(folder, "clock"))) as probe:
        _remove_half_written(Path(folder), probe.stat().st_mtime)


def _remove_half_written(folder, now_s):
    with suppress(OSError):
        for path in folder.glob(f"{HALF}*"):
            with suppress(OSError):  # another process has removed it, or it belongs to another user
                if _was_killed(path.name, HALF) or now_s - path.stat().st_mtime > LONGEST_WRITE_S:
                    path.unlink()


def remove_left_work(folder: AnyPath) -> None:
    """Remove temporary folders of this machine's killed processes from a folder, and folders of Blender's with their
    marks."""
    with suppress(OSError):
        for path in Path(folder).glob(f"{WORK}*"):
            if _was_killed(path.name, WORK):
                shutil.rmtree(path, ignore_errors=True)
        for path in Path(folder).glob(f"{OF_BLENDER}/{WORK}*"):
            if _was_killed(path.name, WORK):
                shutil.rmtree(path.parent, ignore_errors=True)


def mark_as_own(folder: AnyPath) -> None:
    """Mark a folder that Blender has created for this process, so that `remove_left_work` can remove it."""
    with suppress(OSError):
        Path(folder, work_prefix()).touch()


def _was_killed(name, prefix):
    """Whether a name belongs to a process of this machine that has ended."""
    owner = OWNER.match(name, len(prefix))
    return bool(owner) and owner[1] == _machine() and not is_at_work(int(owner[2]))


def work_prefix() -> str:
    """The prefix of this process's temporary folders, which identifies them as its own."""
    return WORK + _owner()


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """A folder that is removed when the block ends; an InputError if it cannot be created."""
    with _pending_path(_new_folder) as folder:
        yield folder


def temporary_root() -> Path:
    """The system's folder for temporary files, found without leaving Python's probe in it if the process is stopped."""
    with uninterrupted():
        return Path(tempfile.gettempdir())


def _new_folder():
    try:
        parent = tempfile.gettempdir()
        if parent not in _swept:
            _swept.add(parent)
            remove_left_work(parent)
        return Path(tempfile.mkdtemp(prefix=work_prefix()))
    except OSError as error:
        raise InputError(tempfile.tempdir or "TMPDIR", "temporary folder", "impossible to create",
                         explain(error)) from None


def pending(path: AnyPath) -> AbstractContextManager[Path]:
    """A file that is removed when the block ends or the process is stopped."""
    return _pending_path(lambda: Path(path))


@contextmanager
def _pending_path(create):
    with _creating:
        path = create()
        _pending.add(path)
    try:
        yield path
    finally:
        remove(path)
        _pending.discard(path)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay `remove_pending`, and thus the end of a process that is being stopped, until the block ends."""
    with _creating:
        yield


def remove_pending() -> list[Path]:
    """Remove all temporary files of a process that is about to be stopped. It cannot create any after this.

    Returns the folders that contain finished work for the next process to resume.
    """
    _creating.acquire()
    for path in list(_pending):
        remove(path)
    return [folder for folder in list(_resumable) if any(map(file_status, matching(folder, "**/[!.]*")))]


def note_resumable(folder: AnyPath) -> None:
    """Report this folder, if the process is stopped, as containing work for the next process to resume."""
    _resumable.add(Path(folder))


def discard(path: Path) -> None:
    """Remove a file that is no longer needed, if it exists; raise an InputError if that fails."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(path, "file", "impossible to remove", explain(error)) from None


def remove(path: Path) -> None:
    """Remove a Lensfield file or folder, if it exists, and the hidden folder around it if that is now empty."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):  # it has been removed, or is open on Windows
            path.unlink()
    if path.parent.name == HIDDEN:
        with suppress(OSError):  # it is not empty
            path.parent.rmdir()
