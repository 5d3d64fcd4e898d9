"""One process at a time: for any holder of a file's lock, killed or not, and in any folder."""

import errno
import os
import signal
import subprocess
import sys

import pytest

from lensfield.engine.runtime import locks
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.files import HIDDEN
from lensfield.engine.runtime.locks import Busy, only_writer
from refusals import refused

HOLD = """
import os, sys, time
from lensfield.engine.runtime.locks import only_writer
with only_writer(sys.argv[1]):
    if len(sys.argv) > 2 and not os.fork():
        time.sleep(600)
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def holder(tmp_path):
    """Starts a process that holds the lock of a file."""
    started = []

    def start(*more):
        process = subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path / "made.exr"), *more],
                                   stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True)
        started.append(process)
        assert process.stdout.readline() == "held\n"
        return process

    yield start
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        process.stdin.close()
        process.stdout.close()


def test_one_at_a_time(holder, tmp_path):
    process = holder()
    with pytest.raises(Busy, match="made.exr: file is being written by another process: wait for it, or give another"):
        with only_writer(tmp_path / "made.exr"):
            pass
    with only_writer(tmp_path / "another.exr"):
        pass
    process.stdin.close()
    process.wait()
    assert not list(tmp_path.iterdir())
    with only_writer(tmp_path / "made.exr"):
        with pytest.raises(Busy), only_writer(tmp_path / "made.exr"):
            pass
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
@pytest.mark.parametrize("more", [(), ("with a worker",)])
def test_a_killed_holder_releases_the_lock(holder, tmp_path, more):
    """Even if a worker that it forked is still running."""
    process = holder(*more)
    process.kill()
    process.wait()
    assert list((tmp_path / HIDDEN).iterdir())
    with only_writer(tmp_path / "made.exr"):
        pass
    assert not list(tmp_path.iterdir())
    if more:
        os.killpg(process.pid, signal.SIGKILL)


def test_a_lock_removed_as_it_is_opened_is_acquired_again(tmp_path, monkeypatch):
    """Its last holder removed it, and the next one created another."""
    lock, tries = locks._lock, []

    def removed_first(handle):
        lock(handle)
        tries.append(handle)
        if len(tries) == 1:
            (tmp_path / HIDDEN / "made.exr.lock").unlink()

    monkeypatch.setattr(locks, "_lock", removed_first)
    with only_writer(tmp_path / "made.exr"):
        assert len(tries) == 2 and (tmp_path / HIDDEN / "made.exr.lock").is_file()


def test_a_folder_that_does_not_support_locks_is_used_without_them(tmp_path, monkeypatch):
    def none(handle):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(locks, "_lock", none)
    with only_writer(tmp_path / "made.exr"):
        pass
    assert not list(tmp_path.iterdir())


def test_a_link_in_place_of_a_lock_is_not_followed(tmp_path):
    (tmp_path / HIDDEN).mkdir()
    (tmp_path / HIDDEN / "made.exr.lock").symlink_to(tmp_path / "precious")
    with refused(InputError, field="file", value="not writable",
                 where="made.exr.lock"), only_writer(tmp_path / "made.exr"):
        pass
    assert not (tmp_path / "precious").exists()


def test_many_processes_never_hold_a_lock_at_once(tmp_path):
    code = f"""
import os, random, sys, time
from lensfield.engine.runtime.locks import Busy, only_writer
held = 0
while held < 20:
    try:
        with only_writer({str(tmp_path / 'made.exr')!r}):
            os.close(os.open({str(tmp_path / 'inside')!r}, os.O_CREAT | os.O_EXCL))
            time.sleep(random.random() / 1000)
            os.unlink({str(tmp_path / 'inside')!r})
            held += 1
    except Busy:
        time.sleep(random.random() / 1000)
"""
    processes = [subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True) for _ in range(4)]
    for process in processes:
        assert process.communicate()[1] == ""
    assert not list(tmp_path.iterdir())
