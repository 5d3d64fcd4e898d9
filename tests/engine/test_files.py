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
