"""What is left of writes that did not end: by processes that were killed, and by those that may still be at work."""

import os
import signal
import subprocess
import sys
import time

import pytest

from lensfield.engine import files
from lensfield.engine.files import LONGEST_WRITE_S, atomic_path

WRITE = """
import sys, time
from lensfield.engine.files import atomic_path
with atomic_path(sys.argv[1]) as temporary:
    temporary.write_text("half")
    print("begun", flush=True)
    time.sleep(600)
"""


@pytest.fixture(autouse=True)
def new_process(monkeypatch):
    monkeypatch.setattr(files, "_swept", set())


def write(path):
    with atomic_path(path) as temporary:
        temporary.write_text("whole")


def kill_while_writing(path):
    with subprocess.Popen([sys.executable, "-c", WRITE, str(path)], stdout=subprocess.PIPE) as process:
        assert process.stdout.readline()
        os.kill(process.pid, getattr(signal, "SIGKILL", signal.SIGTERM))
    left, = path.parent.iterdir()
    return left


def test_what_a_killed_process_left_goes_a_day_later(tmp_path):
    left = kill_while_writing(tmp_path / "picture.exr")
    long_ago = time.time() - LONGEST_WRITE_S - 60
    os.utime(left, (long_ago, long_ago))
    write(tmp_path / "other.exr")
    assert [path.name for path in tmp_path.iterdir()] == ["other.exr"]


def test_what_may_still_be_written_stays(tmp_path):
    left = kill_while_writing(tmp_path / "picture.exr")
    lately = time.time() - LONGEST_WRITE_S + 60
    os.utime(left, (lately, lately))
    write(tmp_path / "other.exr")
    assert left.read_text() == "half"


@pytest.mark.parametrize("name", [".picture-a1b2c3d4.exr", ".lensfield-notes.txt", "picture.exr"])
def test_what_is_of_others_stays_however_old(tmp_path, name):
    (tmp_path / name).write_text("mine")
    os.utime(tmp_path / name, (1e9, 1e9))
    write(tmp_path / "other.exr")
    assert (tmp_path / name).read_text() == "mine"


def test_what_cannot_be_removed_is_no_error(tmp_path):
    folder = tmp_path / f"{files.HALF}folder"
    folder.mkdir()
    os.utime(folder, (1e9, 1e9))
    write(tmp_path / "other.exr")
    assert folder.is_dir() and (tmp_path / "other.exr").read_text() == "whole"


WRITE_AND_STOP = """
import os, sys, threading, time
from pathlib import Path
from lensfield.engine.files import atomic_path, check_target, remove_pending, temporary_folder

def write():
    while True:
        check_target(sys.argv[1])
        with atomic_path(sys.argv[1]), temporary_folder():
            pass

for _ in range(4):
    threading.Thread(target=write, daemon=True).start()
time.sleep(float(sys.argv[2]))
remove_pending()
os._exit(0)
"""


@pytest.mark.parametrize("after_s", [0.05, 0.06, 0.07])
def test_nothing_is_begun_while_a_process_is_being_stopped(tmp_path, after_s):
    folder, work = tmp_path / "pictures", tmp_path / "work"
    work.mkdir()
    subprocess.run([sys.executable, "-c", WRITE_AND_STOP, str(folder / "picture.exr"), str(after_s)], check=True,
                   env=os.environ | {"TMPDIR": str(work)})
    assert not list(folder.glob(f"{files.HALF}*")) and not list(work.iterdir())
