"""Files appear whole or not at all.

They are half-written under names that tell whose they are, flushed to the disk, and renamed. What cannot be written is
told by its own name and by what the system says. What processes that were killed have left half-written is removed by
whoever next writes there.
"""

import hashlib
import os
import platform
import re
import shutil
import tempfile
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import IO

from .errors import InputError

AnyPath = str | os.PathLike[str]

MARK = "Made by Lensfield"  # what each file says of itself, near its beginning
MARKS = MARK.lower().encode(), b"psf_amplitude.npy", b"seconds_over_paper"  # the array of a package, a table's column
HEAD_BYTES, LONGEST_HEAD_BYTES = 1 << 16, 1 << 20  # a header of 10,000 channels takes less than the second
HALF = ".lensfield-half-written-"
HIDDEN = ".lensfield"
WORK = "lensfield-work-"
OWNER = re.compile(r"([0-9a-f]{8})-(\d+)-")  # what follows either of these: the machine, and its process
LONGEST_WRITE_S = 24 * 3600.0
PROBE_BYTES = 1 << 20
UMASK = os.umask(0)  # it can only be read by setting it, which is not for a thread to do
os.umask(UMASK)
_pending: set[Path] = set()
_making = threading.Lock()  # whoever makes something half-written, and notes it
_swept: set[AnyPath] = set()
_going_on: set[Path] = set()


def make_folder(path: AnyPath) -> None:
    """Make a folder and those above it; an InputError where that cannot be."""
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(path, "folder", "not to be made", error.strerror or str(error)) from None


def nearest_there(path: AnyPath) -> Path:
    """A path itself, or the nearest of those above it that is there."""
    return next(place for place in (Path(path), *Path(path).absolute().parents) if place.exists())


def hidden_folder(folder: AnyPath) -> Path:
    """The folder in one of outputs, for what is of use until they are there. Nothing makes it yet; empty, it goes.

    Raises
    ------
    InputError
        It is a link, which folders of strangers may have: what is removed and written there could be anything.
    """
    hidden = Path(folder).resolve() / HIDDEN
    if hidden.is_symlink():
        raise InputError(hidden, "folder", "a link", "remove it")
    return hidden


def check_target(path: AnyPath, own: bool = False) -> None:
    """Raise an InputError where no file of this name could or should be written, before the work that is to fill it.

    Parameters
    ----------
    path : path
    own : bool
        Whether all files are ours where it lies. Else one that is there has to be: nobody's own file is overwritten.
    """
    try:
        path, named = Path(path).resolve(), path  # through a link, to where it will be written
    except (OSError, RuntimeError) as error:  # links in a circle
        raise InputError(path, "file", "not to be found", str(error)) from None
    if path.is_dir():
        raise InputError(named, "file", "a folder", "give the name of a file to write")
    if path.exists() and not path.is_file():
        raise InputError(named, "file", "a device or pipe", "give the name of a file to write")
    if not own:
        check_ours(named)
    make_folder(path.parent)
    try:
        with _making:
            handle, probe = tempfile.mkstemp(prefix=HALF, dir=path.parent)
            os.close(handle)
            os.unlink(probe)
    except OSError as error:
        raise InputError(path, "file", "not writable", error.strerror or str(error)) from None


def check_ours(path: AnyPath) -> None:
    """Raise an InputError for a file that is there and was not written by Lensfield: it is somebody's own."""
    if not _is_ours(path):
        raise InputError(path, "file", "there already, and none that Lensfield has made",
                         "move it, or give another name or folder")


def _is_ours(path):
    """Whether Lensfield has written a file, or there is nothing to lose: no file, an empty one, or one of zeros."""
    try:
        with open(path, "rb") as file:
            head = file.read(HEAD_BYTES)  # of many frames, over a network, no more than it takes
            if not _is_marked(head):
                head += file.read(LONGEST_HEAD_BYTES)
    except (FileNotFoundError, NotADirectoryError):
        return True
    except OSError:  # of somebody else, who lets nobody read it
        return False
    return _is_marked(head) or not head.strip(b"\0")


def _is_marked(head):
    head = head.lower()
    return any(mark in head for mark in MARKS)


def identity(path: AnyPath) -> tuple[int, int] | tuple[int, int, str]:
    """What all names of one file share, before it is there too: file systems may not tell upper from lower case."""
    path = Path(path).resolve()
    try:
        status = path.stat()
    except OSError:
        folder = path.parent.stat()
        return folder.st_dev, folder.st_ino, path.name.casefold()
    return status.st_dev, status.st_ino


@contextmanager
def atomic_path(path: AnyPath, own: bool = False) -> Iterator[Path]:
    """A temporary path beside `path`: flushed and moved onto it when the block ends well, removed when it does not.

    `own` is as for `check_target`.

    Raises
    ------
    InputError
        What is written in the block, or on its way to the disk, meets an error of the system: a full disk, say.
    """
    check_target(path, own)
    named, path = path, Path(path).resolve()  # through a link, which stays
    try:
        with _pending_path(lambda: _half_written(path)) as temporary:
            if path.parent not in _swept:
                _swept.add(path.parent)
                _remove_half_written(path.parent, temporary.stat().st_mtime)
            yield temporary
            os.chmod(temporary, 0o666 & ~UMASK)  # mkstemp makes files that only their owner can read
            _flush(temporary)
            os.replace(temporary, path)
            _flush_folder(path.parent)
    except OSError as error:
        raise InputError(named, "file", "not written whole", error.strerror or str(error)) from None


def link_or_copy(source: AnyPath, path: AnyPath) -> None:
    """Give a file another name as well, which it keeps if the first goes; or copy it where that cannot be."""
    if Path(path).exists() and os.path.samefile(source, path):
        return
    with atomic_path(path) as temporary:
        try:
            temporary.unlink()
            os.link(source, temporary)
        except OSError:  # another disk, or one that knows no links
            shutil.copyfile(source, temporary)


def stamp_of(path: AnyPath) -> tuple[int, int, int] | None:
    """What is another one as soon as a file is written again, or a file of a folder comes or goes; None for none."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):  # the latter of a text that no file can be called by
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def move(source: AnyPath, path: AnyPath) -> None:
    """Move a file to a folder of our own, where it appears whole or not at all, from another disk too."""
    with atomic_path(path, own=True) as temporary:
        try:
            os.replace(source, temporary)
        except OSError:
            shutil.copyfile(source, temporary)
            os.unlink(source)


def fill(file: IO[bytes], size_bytes: int) -> None:
    """Write so many zeros."""
    for written in range(0, size_bytes, PROBE_BYTES):
        file.write(bytes(min(PROBE_BYTES, size_bytes - written)))


def why_no_room(folder: AnyPath, size_bytes: int) -> str:
    """Why a folder does not take a file of so many bytes, by trying: "" where it does."""
    try:
        with _pending_path(lambda: _half_written(Path(folder, "room"))) as probe, open(probe, "wb") as file:
            fill(file, size_bytes)
    except OSError as error:
        return error.strerror or str(error)
    return ""


def _half_written(path):
    handle, name = tempfile.mkstemp(prefix=f"{HALF}{_owner()}{path.stem[:40]}-", suffix=path.suffix, dir=path.parent)
    os.close(handle)
    return Path(name)


def _flush(path):
    """Have a file on the disk itself: only now do some file systems tell that they have no room for it."""
    with open(path, "rb+") as file:
        os.fsync(file.fileno())


def _flush_folder(folder):
    """Have a folder's names on the disk itself, where the system can do that."""
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
    """What tells this machine from others that write to the same disk; containers by their own count of processes."""
    processes = ""
    with suppress(OSError):  # only Linux has it
        processes = os.readlink("/proc/self/ns/pid")
    return hashlib.sha256(f"{platform.node()} {processes}".encode()).hexdigest()[:8]


def is_at_work(process: int) -> bool:
    """Whether a process of this machine runs. (Windows does not tell: there each one may.)"""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # another user's
        return True
    return True


def _remove_half_written(folder, now_s):
    """Remove what processes that were killed have left half-written in a folder: those of this machine at once, others
    by age alone, on the clock that stamps the folder's files; they may be at work on other machines."""
    with suppress(OSError):
        for path in folder.glob(f"{HALF}*"):
            with suppress(OSError):  # another has been quicker, or it is not ours to remove
                if _was_killed(path.name, HALF) or now_s - path.stat().st_mtime > LONGEST_WRITE_S:
                    path.unlink()


def remove_left_work(folder: AnyPath) -> None:
    """Remove the temporary folders in this one of processes of this machine that were killed."""
    with suppress(OSError):
        for path in Path(folder).glob(f"{WORK}*"):
            if _was_killed(path.name, WORK):
                shutil.rmtree(path, ignore_errors=True)


def _was_killed(name, prefix):
    """Whether what is called so is of a process of this machine that has ended."""
    owner = OWNER.match(name, len(prefix))
    return bool(owner) and owner[1] == _machine() and not is_at_work(int(owner[2]))


def work_prefix() -> str:
    """What the names of temporary folders begin with, so that they can be told to be of this process."""
    return WORK + _owner()


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """A folder that is removed when the block ends; an InputError where there is no room for one."""
    with _pending_path(_new_folder) as folder:
        yield folder


def _new_folder():
    try:
        place = tempfile.gettempdir()
        if place not in _swept:
            _swept.add(place)
            remove_left_work(place)
        return Path(tempfile.mkdtemp(prefix=work_prefix()))
    except OSError as error:
        raise InputError(tempfile.tempdir or "TMPDIR", "temporary folder", "not to be made",
                         error.strerror or str(error)) from None


def pending(path: AnyPath) -> AbstractContextManager[Path]:
    """A file that is removed when the block ends, or the process is stopped."""
    return _pending_path(lambda: Path(path))


@contextmanager
def _pending_path(make):
    with _making:
        path = make()
        _pending.add(path)
    try:
        yield path
    finally:
        remove(path)
        _pending.discard(path)


def remove_pending() -> list[Path]:
    """Remove all that is half-written; for a process that is about to be stopped: nothing can be begun after this.

    Returns the folders that hold what it would go on from.
    """
    _making.acquire()
    for path in list(_pending):
        remove(path)
    return [folder for folder in _going_on if any(path.is_file() for path in folder.rglob("[!.]*"))]


def note_going_on(folder: AnyPath) -> None:
    """Have it told, where the process is stopped, that this folder holds what the next one goes on from."""
    _going_on.add(Path(folder))


def discard(path: Path) -> None:
    """Remove a file that is of no more use, if it is there; an InputError where it stays."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(path, "file", "not to be removed", error.strerror or str(error)) from None


def remove(path: Path) -> None:
    """Remove a file or folder of ours, if it is there, and the hidden folder that it was the last in."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):  # it is gone, or open and of Windows
            path.unlink()
    if path.parent.name == HIDDEN:
        with suppress(OSError):  # there is more in it
            path.parent.rmdir()
