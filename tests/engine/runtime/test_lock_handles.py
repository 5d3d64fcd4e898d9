"""File handles of locks: each exit from a lock closes the handle that it opened, because a process has few."""

import errno
import os
import subprocess
import sys

import pytest

from lensfield.engine.runtime import locks
from lensfield.engine.runtime.files import HIDDEN
from lensfield.engine.runtime.locks import Busy, only_writer

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems list handles elsewhere")
FOLDER = "/proc/self/fd"


@pytest.fixture
def all_are_closed():
    before = sorted(os.listdir(FOLDER))
    yield
    assert sorted(os.listdir(FOLDER)) == before


def test_a_released_lock(all_are_closed, tmp_path):
    for _ in range(3):
        with only_writer(tmp_path / "made.exr"):
            pass


def test_a_lock_whose_holder_fails(all_are_closed, tmp_path):
    with pytest.raises(ZeroDivisionError), only_writer(tmp_path / "made.exr"):
        raise ZeroDivisionError


def test_a_lock_that_another_process_holds(tmp_path):
    code = (f"import sys; from lensfield.engine.runtime.locks import only_writer\n"
            f"with only_writer({str(tmp_path / 'made.exr')!r}): print(flush=True), sys.stdin.read()")
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        before = sorted(os.listdir(FOLDER))
        for _ in range(3):
            with pytest.raises(Busy), only_writer(tmp_path / "made.exr"):
                pass
        assert sorted(os.listdir(FOLDER)) == before


def test_a_lock_that_is_removed_as_it_is_opened(all_are_closed, tmp_path, monkeypatch):
    lock, tries = locks._lock, []

    def removed_first(handle):
        lock(handle)
        tries.append(handle)
        if len(tries) < 4:
            (tmp_path / HIDDEN / "made.exr.lock").unlink()

    monkeypatch.setattr(locks, "_lock", removed_first)
    with only_writer(tmp_path / "made.exr"):
        assert len(tries) == 4


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EIO])
def test_a_lock_that_cannot_be_acquired(all_are_closed, tmp_path, monkeypatch, number):
    """Work continues in a folder that does not support locks; other errors are raised."""
    def fail(handle):
        raise OSError(number, "no lock")

    monkeypatch.setattr(locks, "_lock", fail)
    if number == errno.ENOLCK:
        with only_writer(tmp_path / "made.exr"):
            pass
    else:
        with pytest.raises(OSError, match="no lock"), only_writer(tmp_path / "made.exr"):
            pass
