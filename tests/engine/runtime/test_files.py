"""Writes to a full disk, and the remains of writes by processes that were killed or may still be running."""

import errno
import os
import signal
import stat
import subprocess
import sys
import time
from dataclasses import fields
from functools import partial

import numpy as np
import pytest

from full_disk import room_for
from lensfield.cli import main
from lensfield.engine import InputError, Report, load_lens
from lensfield.engine.inspection.tradeoff import Row, write_table
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.library import PRESCRIPTIONS
from lensfield.engine.pictures.preview import write_png
from lensfield.engine.runtime import files
from lensfield.engine.runtime.files import LONGEST_WRITE_S, atomic_path, check_target, link_or_copy
from places import SAMPLE_SCENE
from refusals import refused

posix = pytest.mark.skipif(os.name != "posix", reason="Windows does not report which processes are running")

WRITE = """
import sys, time
from lensfield.engine.runtime.files import atomic_path
with atomic_path(sys.argv[1]) as temporary:
    temporary.write_text("half")
    print("begun", flush=True)
    time.sleep(600)
"""


@pytest.fixture(autouse=True)
def new_process(monkeypatch):
    monkeypatch.setattr(files, "_swept", set())


def write(path, overwrite=True):
    with atomic_path(path, overwrite) as temporary:
        temporary.write_text("whole")


def writer(path):
    process = subprocess.Popen([sys.executable, "-c", WRITE, str(path)], stdout=subprocess.PIPE)
    assert process.stdout.readline()
    return process


def kill(process):
    with process:
        os.kill(process.pid, getattr(signal, "SIGKILL", signal.SIGTERM))


@posix
def test_remains_of_a_killed_process_are_removed_by_the_next_write(tmp_path):
    kill(writer(tmp_path / "picture.exr"))
    assert list(tmp_path.iterdir())
    write(tmp_path / "other.exr")
    assert [path.name for path in tmp_path.iterdir()] == ["other.exr"]


def test_a_file_that_a_running_process_is_writing_stays(tmp_path):
    process = writer(tmp_path / "picture.exr")
    try:
        half, = tmp_path.iterdir()
        write(tmp_path / "other.exr")
        assert half.read_text() == "half"
    finally:
        kill(process)


@pytest.mark.parametrize("owner", [f"{files._machine()}-{os.getppid()}-", f"{'0' * 8}-{2**31}-", ""],
                         ids=["a process at work", "another machine", "an older version"])
def test_remains_of_any_owner_are_removed_a_day_later(tmp_path, owner):
    left = tmp_path / f"{files.HALF}{owner}picture-a1b2c3.exr"
    for age_s in (-60, 60):
        left.write_text("half")
        then = time.time() - LONGEST_WRITE_S - age_s
        os.utime(left, (then, then))
        files._swept.clear()
        write(tmp_path / "other.exr")
        assert left.exists() == (age_s < 0)


@posix
def test_temporary_folders_of_killed_processes_are_removed_with_the_next_one(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    left = {pid: tmp_path / f"{files.WORK}{files._machine()}-{pid}-abc" for pid in (ended.pid, os.getppid())}
    elsewhere, others = tmp_path / f"{files.WORK}{'0' * 8}-{ended.pid}-abc", tmp_path / "lensfield-renders"
    for folder in (*left.values(), elsewhere, others):
        folder.mkdir()
        (folder / "pass.exr").write_text("half")
    with files.temporary_folder() as created:
        assert set(tmp_path.iterdir()) == {created, left[os.getppid()], elsewhere, others}


def test_a_temporary_folder_that_cannot_be_created_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "gone"))
    with pytest.raises(InputError, match=r"gone: temporary folder is impossible to create: No such file or directory$"):
        with files.temporary_folder():
            pass


def test_a_file_is_on_the_disk_before_it_is_renamed(tmp_path, monkeypatch):
    events = []
    monkeypatch.setattr(os, "fsync", lambda handle: events.append("folder" if stat.S_ISDIR(os.fstat(handle).st_mode)
                                                                  else "file"))
    replace = os.replace
    monkeypatch.setattr(os, "replace", lambda *paths: events.append("name") or replace(*paths))
    write(tmp_path / "picture.exr")
    assert events[:2] == ["file", "name"] and events[2:] == ["folder"] * (os.name == "posix")


def test_a_disk_that_is_full_only_at_the_end_leaves_the_old_file(tmp_path, monkeypatch):
    """As network disks do."""
    def fail(handle):
        raise OSError(errno.EDQUOT, "Disk quota exceeded")

    path = tmp_path / "picture.exr"
    path.write_text("old")
    monkeypatch.setattr(os, "fsync", fail)
    with refused(InputError, field="file", where="picture.exr", match="Disk quota exceeded$"):
        write(path)
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_a_folder_that_disappears_is_an_error(tmp_path):
    path = tmp_path / "pictures" / "picture.exr"
    with pytest.raises(InputError, match=r"picture.exr: file is not written: No such file or directory$"):
        with atomic_path(path) as temporary:
            temporary.unlink()
            path.parent.rmdir()
    assert list(tmp_path.iterdir()) == []


def no_links(*_):
    raise OSError(errno.EXDEV, "Invalid cross-device link")


@posix
@pytest.mark.parametrize("write", [
    lambda path: write_png(np.full((40, 60, 3), np.arange(60)[:, None] / 60, np.float32), path, 1.0),
    lambda path: Report({"plan": 1.0}).write(path),
    lambda path: write_package(load_lens("edmund-54852"), path),
    lambda path: files.link_or_copy(SAMPLE_SCENE, path),
], ids=["picture", "report", "package", "copy"])
def test_a_full_disk_is_an_error_that_names_the_file(tmp_path, monkeypatch, write):
    monkeypatch.setattr(os, "link", no_links)
    with room_for(30), refused(InputError, field="file", where="file.out", match="File too large$"):
        write(tmp_path / "file.out")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_explained_by_the_systems_error(tmp_path):
    assert files.why_no_room(tmp_path, 3 * files.PROBE_BYTES + 1) == ""
    assert "No such file" in files.why_no_room(tmp_path / "gone", 1)
    with room_for(2 * files.PROBE_BYTES):
        assert files.why_no_room(tmp_path, 3 * files.PROBE_BYTES) == "File too large"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", [".picture-a1b2c3d4.exr", ".lensfield-notes.txt", "picture.exr"])
def test_foreign_files_stay_however_old(tmp_path, name):
    (tmp_path / name).write_text("mine")
    os.utime(tmp_path / name, (1e9, 1e9))
    write(tmp_path / "other.exr")
    assert (tmp_path / name).read_text() == "mine"


@pytest.mark.skipif(os.name != "posix", reason="other systems report it differently")
def test_a_file_that_cannot_be_discarded_is_an_error(tmp_path):
    files.discard(tmp_path / "gone.json")
    (tmp_path / "out").write_text("no folder any more")
    with pytest.raises(InputError, match=r"out/report.json: file is impossible to remove: Not a directory"):
        files.discard(tmp_path / "out" / "report.json")


def test_remains_that_cannot_be_removed_are_ignored(tmp_path):
    folder = tmp_path / f"{files.HALF}folder"
    folder.mkdir()
    os.utime(folder, (1e9, 1e9))
    write(tmp_path / "other.exr")
    assert folder.is_dir() and (tmp_path / "other.exr").read_text() == "whole"


WRITE_AND_STOP = """
import os, sys, threading, time
from pathlib import Path
from lensfield.engine.runtime.files import atomic_path, check_target, remove_pending, temporary_folder

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
def test_no_file_is_begun_while_a_process_is_being_stopped(tmp_path, after_s):
    folder, work = tmp_path / "pictures", tmp_path / "work"
    work.mkdir()
    subprocess.run([sys.executable, "-c", WRITE_AND_STOP, str(folder / "picture.exr"), str(after_s)], check=True,
                   env=os.environ | {"TMPDIR": str(work)})
    assert not list(folder.glob(f"{files.HALF}*")) and not list(work.iterdir())


MAKE_AND_TIDY = """
import os, sys
from pathlib import Path
from lensfield.engine.runtime import files, locks
from lensfield.engine.runtime.files import HIDDEN, HALF, atomic_path, check_target, make_folder, matching, move, remove

folder, own = Path(sys.argv[1], HIDDEN, "passes", "of one"), sys.argv[2]
own_file = folder / f"{own}.txt"
sys.stdin.readline()
for turn in range(400):
    make_folder(folder)
    for tidied in (folder, *folder.parents[:2]):
        try:
            tidied.rmdir()
        except OSError:  # another process is using it
            pass
    if turn % 8 == 0:
        check_target(own_file)
        with atomic_path(own_file, overwrite=True) as temporary:
            temporary.write_text(own)
        assert own in [path.stem for path in matching(folder, "[!.]*.txt")]
        own_file.unlink()
        with locks.only_writer(Path(sys.argv[1], f"{own}.exr")):
            pass
"""


def test_processes_that_create_and_remove_the_same_folder_do_not_fail(tmp_path):
    processes = [subprocess.Popen([sys.executable, "-c", MAKE_AND_TIDY, str(tmp_path), str(number)],
                                  stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for number in range(6)]
    for process in processes:  # all are loaded before the first begins
        process.stdin.write("begin\n")
    for process in processes:
        process.stdin.flush()
    assert [process.communicate()[1] for process in processes] == [""] * 6


@pytest.mark.parametrize("gone", [1, 2, 7])
def test_a_folder_removed_before_its_file_is_created_is_created_again(tmp_path, gone):
    tries = []

    def create():
        tries.append(files.stamp_of(tmp_path / "a" / "b"))
        if len(tries) <= gone:
            (tmp_path / "a" / "b").rmdir()
            (tmp_path / "a").rmdir()
        return os.open(tmp_path / "a" / "b" / "file", os.O_CREAT)

    os.close(files.create_in(tmp_path / "a" / "b", create))
    assert len(tries) == gone + 1 and all(tries)


def test_a_file_in_place_of_a_folder_is_reported(tmp_path):
    (tmp_path / "out").write_text("a file")
    (tmp_path / "nowhere").symlink_to(tmp_path / "gone" / "folder")
    for path, why in (("out", "File exists: a file or link .*"), ("nowhere", "File exists: a file or link .*"),
                      ("out/deep", "Not a directory: a parent of this path is a file; correct the path")):
        with pytest.raises(InputError, match=f"{path}: folder is impossible to create: {why}$"):
            files.make_folder(tmp_path / path)


LONG = "n" * 300


@posix
@pytest.mark.parametrize("path, why", [
    (f"{LONG}.exr", "File name too long: give a shorter path"),
    (f"{LONG}/picture.exr", "File name too long: give a shorter path"),
    ("circle/picture.exr", "Too many levels of symbolic links: remove the circular link"),
    ("a file/picture.exr", "File exists: a file or link has this name"),
    ("a\0b.exr", "remove the null character from the path"),
    ("folder", "file is a folder: give the name of a file to write")])
def test_a_path_that_cannot_be_written_gives_one_line_with_a_remedy(tmp_path, path, why):
    (tmp_path / "circle").symlink_to(tmp_path / "circle")
    (tmp_path / "a file").write_text("")
    (tmp_path / "folder").mkdir()
    for attempt in (check_target, write):
        with pytest.raises(InputError) as caught:
            attempt(tmp_path / path)
        message, named, kind = str(caught.value), path, "file"
        if path.startswith("a file/"):
            named, kind = "a file", "folder"
        assert why in message and f": {kind} is " in message and "Errno" not in message
        assert caught.value.where.endswith(named[-20:].replace("\0", "?"))
        assert "\n" not in message
    assert {entry.name for entry in tmp_path.iterdir()} == {"circle", "a file", "folder"}


@posix
@pytest.mark.parametrize("number, remedy", [(errno.EACCES, "change its permissions"), (errno.EPERM, "permissions"),
                                            (errno.EROFS, "on a writable disk"), (errno.ENOSPC, "")])
def test_a_refusal_by_the_system_has_a_remedy(tmp_path, monkeypatch, number, remedy):
    """With a stand-in for the system: tests may run as root, to whom permissions do not apply."""
    def refuse(*_, **__):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(files.tempfile, "mkstemp", refuse)
    with pytest.raises(InputError, match=f"file is not writable: {os.strerror(number)}.*{remedy}"):
        check_target(tmp_path / "picture.exr")


@posix
def test_a_long_suffix_does_not_lengthen_the_half_written_name(tmp_path):
    name = f"p.{'s' * 250}"
    write(tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == [name]


FOREIGN = b"a picture by another program"


def test_a_foreign_file_is_not_overwritten(tmp_path):
    path = tmp_path / "picture.exr"
    path.write_bytes(FOREIGN)
    for attempt in (check_target, partial(write, overwrite=False)):
        with refused(InputError, field="file", value="an existing file that Lensfield did not write",
                     where="picture.exr"):
            attempt(path)
    assert path.read_bytes() == FOREIGN and list(tmp_path.iterdir()) == [path]


def test_a_foreign_file_behind_a_link_is_not_overwritten(tmp_path):
    (tmp_path / "own.exr").write_bytes(FOREIGN)
    (tmp_path / "link.exr").symlink_to(tmp_path / "own.exr")
    with refused(InputError, field="file", value="an existing file that Lensfield did not write", where="link.exr"):
        check_target(tmp_path / "link.exr")


def test_an_unreadable_foreign_file_is_not_overwritten(tmp_path, monkeypatch):
    (tmp_path / "own.exr").write_bytes(FOREIGN)

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")
    monkeypatch.setattr(files, "open", refuse, raising=False)
    with refused(InputError, field="file", value="an existing file that Lensfield did not write", where="own.exr"):
        check_target(tmp_path / "own.exr")


@pytest.mark.parametrize("contents", [b"", bytes(5000), b"x" * 1000 + files.MARK.encode() + bytes(5000)],
                         ids=["empty", "zeros, of a disk that lost its power", "ours"])
def test_empty_and_lensfield_files_are_overwritten(tmp_path, contents):
    (tmp_path / "picture.exr").write_bytes(contents)
    write(tmp_path / "picture.exr", overwrite=False)
    assert (tmp_path / "picture.exr").read_text() == "whole"


def test_files_written_by_commands_are_recognised_as_lensfield_files(tmp_path, monkeypatch):
    """Each is written twice: our own files are not taken for the user's."""
    monkeypatch.chdir(tmp_path)
    prescription = PRESCRIPTIONS / "tessar-50mm.toml"
    commands = (("lens", "convert", prescription, "-o", "again.toml"), ("lens", "export-macro", "zemax", "-o", "a.zpl"),
                ("lens", "export-macro", "codev", "-o", "a.seq"), ("lens", "export-macro", "zospy", "-o", "a.py"),
                ("lens", "plot", "edmund-54852", "-o", "sheet.png"),
                ("lens", "stmap", "edmund-54852", "--resolution", "12x9", "--output", "maps"))
    for command in commands:
        for _ in range(2):
            assert main([str(word) for word in command]) == 0
    lens = load_lens("edmund-54852")
    row = dict.fromkeys((field.name for field in fields(Row)), 1.0)
    for _ in range(2):
        write_package(lens, tmp_path / "lens.npz")
        write_table([Row(**row)], tmp_path / "tradeoff.csv")
        Report().write(tmp_path / "report.json")


@pytest.mark.skipif(os.name != "posix", reason="Windows has no such permissions")
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o444, 0o664])
def test_a_rewritten_file_keeps_its_permissions(tmp_path, mode):
    path = tmp_path / "frame.exr"
    path.touch()
    path.chmod(mode)
    with atomic_path(path) as temporary:
        temporary.write_text("new")
    assert path.read_text() == "new" and path.stat().st_mode & 0o777 == mode


@pytest.mark.skipif(os.name != "posix", reason="Windows has no such permissions")
def test_a_hard_link_does_not_change_its_files_permissions(tmp_path):
    source, path = tmp_path / "radiance.exr", tmp_path / "other.exr"
    source.write_text("light")
    source.chmod(0o600)
    path.touch()
    link_or_copy(source, path)
    assert path.read_text() == "light" and path.stat().st_mode & 0o777 == source.stat().st_mode & 0o777 == 0o600
