"""Available memory, and budgets of memory for caches."""

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from .errors import ImageError

GIGABYTE = 1e9
PROC, CONTROL_GROUPS = Path("/proc"), Path("/sys/fs/cgroup")
NO_LIMIT = 2**60  # bytes: version 1 of control groups reports at least this for groups without a limit


def available_bytes() -> int:
    """Bytes of memory that this process can still allocate: the machine's free memory, within the process's limits.

    The limits are set by control groups, as containers and batch systems use them, and by `ulimit -v`.
    """
    return max(0, min([_free_on_machine(), *_free_in_groups(), *_free_in_address_space()]))


def taken_bytes() -> int:
    """Bytes of memory that this process occupies; 0 on systems that do not report it."""
    with suppress(OSError):
        pages = (PROC / "self/statm").read_text().split()[1]
        return os.sysconf("SC_PAGE_SIZE") * int(pages)
    return 0


def check_room(where: object, needed_bytes: float, remedy: str) -> None:
    """Raise an ImageError unless this much memory is available."""
    if needed_bytes > (available := available_bytes()):
        raise ImageError(where, "size", f"{needed_bytes / GIGABYTE:.3g} GB in memory",
                         f"{available / GIGABYTE:.3g} GB are free: {remedy}")


def _free_on_machine():
    """Memory available without swapping out other programs; all memory on systems that do not report it."""
    with suppress(OSError, StopIteration):
        lines = (PROC / "meminfo").read_text().splitlines()
        return 1024 * int(next(line.split()[1] for line in lines if line.startswith("MemAvailable:")))
    if sys.platform == "win32":
        return _free_on_windows()
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _free_on_windows():
    import ctypes

    fields = ("total", "available", "total_paged", "available_paged", "total_virtual", "available_virtual", "extended")

    class Status(ctypes.Structure):
        _fields_ = [("length", ctypes.c_ulong), ("load", ctypes.c_ulong),
                    *((name, ctypes.c_ulonglong) for name in fields)]

    status = Status(length=ctypes.sizeof(Status))
    ctypes.windll.kernel32.GlobalMemoryStatusEx(ctypes.byref(status))
    return min(status.available, status.available_paged)


def _free_in_groups() -> Iterator[int]:
    """Free bytes in this process's control groups and their parents."""
    with suppress(OSError):
        for line in (PROC / "self/cgroup").read_text().splitlines():
            _, kinds, place = line.split(":", 2)
            if kinds == "":
                yield from _free_up_to(CONTROL_GROUPS, place, "memory.max", "memory.current", "")
            elif "memory" in kinds.split(","):
                yield from _free_up_to(CONTROL_GROUPS / "memory", place, "memory.limit_in_bytes",
                                       "memory.usage_in_bytes", "total_")


def _free_up_to(root, place, limit, used, all_of):
    """Free bytes of the group at a place below `root` and of each of its parents, for groups with a limit.

    Pages of files count as free, because the system reclaims them.
    """
    folder = root / place.lstrip("/")
    for group in (folder, *folder.parents):
        with suppress(OSError, ValueError):  # a group without a limit reports "max"; other users' files are hidden
            most = int((group / limit).read_text())
            stat = dict(line.split() for line in (group / "memory.stat").read_text().splitlines())
            if most < NO_LIMIT:
                files = sum(int(stat.get(f"{all_of}{kind}_file", 0)) for kind in ("inactive", "active"))
                yield most - int((group / used).read_text()) + files
        if group == root:
            break


def _free_in_address_space() -> Iterator[int]:
    """Free bytes within `ulimit -v`, if it is set and the system reports how much is used."""
    with suppress(ImportError, OSError):
        import resource

        most = resource.getrlimit(resource.RLIMIT_AS)[0]
        if most != resource.RLIM_INFINITY:
            yield most - resource.getpagesize() * int((PROC / "self/statm").read_text().split()[0])


class MemoryBudget:
    """A budget of memory that any thread may take a part of, permanently."""

    def __init__(self, size_bytes: float) -> None:
        self._left, self._lock = size_bytes, threading.Lock()

    def take(self, size_bytes: int) -> bool:
        """Take this much and return True; or return False if it exceeds the rest."""
        with self._lock:
            if size_bytes > self._left:
                return False
            self._left -= size_bytes
            return True
