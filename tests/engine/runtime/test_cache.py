"""Cached data are returned complete or not at all, and never cause an error."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from lensfield.engine.runtime import cache
from waiting import LAST_RESORT_S

KEY, OTHER = bytes(range(32)), bytes(range(1, 33))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("LENSFIELD_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def only_file(folder):
    path, = (folder / "kind").iterdir()
    return path


def test_content_is_loaded_only_by_its_kind_and_key(folder):
    for content in (b"", b"a\nb\n", bytes(range(256))):
        cache.store("kind", KEY, content, 2000)
        assert cache.load("kind", KEY) == content
    assert cache.load("kind", OTHER) is None and cache.load("other", KEY) is None


@pytest.mark.parametrize("damage", [lambda valid: b"", lambda valid: valid[:-1], lambda valid: valid + b" ",
                                    lambda valid: valid[:70] + b"X" + valid[71:], lambda valid: b"an older kind\n{}",
                                    lambda valid: bytes(1000)])
def test_a_damaged_file_counts_as_missing(folder, damage):
    cache.store("kind", KEY, b"0123456789", 2000)
    only_file(folder).write_bytes(damage(only_file(folder).read_bytes()))
    assert cache.load("kind", KEY) is None
    cache.store("kind", KEY, b"0123456789", 2000)
    assert cache.load("kind", KEY) == b"0123456789"


def test_an_entry_copied_to_another_name_counts_as_missing(folder):
    for key, content in ((KEY, b"some"), (OTHER, b"other")):
        cache.store("kind", key, content, 2000)
    one, two = (folder / "kind").iterdir()
    one.write_bytes(two.read_bytes())
    assert sorted(filter(None, (cache.load("kind", key) for key in (KEY, OTHER)))) in ([b"some"], [b"other"])


@pytest.mark.skipif(os.name != "posix", reason="POSIX only")
@pytest.mark.parametrize("place", [os.mkfifo, lambda path: path.symlink_to("/dev/zero"),
                                   lambda path: path.symlink_to(path.parent / "missing")])
def test_an_entry_that_is_no_file_counts_as_missing_and_is_replaced(folder, place):
    cache.store("kind", KEY, b"some", 2000)
    path = only_file(folder)
    path.unlink()
    place(path)
    assert cache.load("kind", KEY) is None
    cache.store("kind", KEY, b"some", 2000)
    assert cache.load("kind", KEY) == b"some" and path.is_file() and not path.is_symlink()


@pytest.mark.skipif(os.name != "posix", reason="links need a privilege")
def test_a_link_in_the_cache_does_not_lead_to_another_file(folder, tmp_path):
    (tmp_path / "mine").write_text("mine")
    cache.store("kind", KEY, b"some", 2000)
    only_file(folder).unlink()
    path = cache._path(folder, "kind", KEY)
    path.symlink_to(tmp_path / "mine")
    cache.store("kind", KEY, b"some", 2000)
    assert (tmp_path / "mine").read_text() == "mine" and cache.load("kind", KEY) == b"some"


def test_an_implausibly_large_file_is_not_read(folder, monkeypatch):
    cache.store("kind", KEY, bytes(1000), 2000)
    monkeypatch.setattr(cache, "MOST_FILE_BYTES", 1000)
    assert cache.load("kind", KEY) is None


def test_content_that_cannot_be_read_counts_as_missing(folder):
    cache.store("kind", KEY, b"12", 2000)
    assert cache.load("kind", KEY, int) == 12
    cache.store("kind", KEY, b"junk", 2000)
    assert cache.load("kind", KEY, int) is None


def test_the_least_recently_used_files_are_removed_first(folder):
    keys = [bytes([number] * 32) for number in range(6)]
    most = 4 * (64 + 1 + len(b"some"))
    for age, key in enumerate(keys[:4]):
        cache.store("kind", key, b"some", most)
        os.utime(cache._path(folder, "kind", key), (1e9 + age, 1e9 + age))
    assert cache.load("kind", keys[0])
    for key in keys[4:]:
        cache.store("kind", key, b"some", most)
    assert [cache.load("kind", key) is not None for key in keys] == [True, False, False, True, True, True]


def test_it_reports_its_size_and_can_be_cleared(folder):
    assert cache.size_bytes("kind") == (0, 0)
    cache.clear("kind")
    cache.store("kind", KEY, b"some", 2000)
    cache.store("other", KEY, b"some", 2000)
    assert cache.size_bytes("kind") == (1, only_file(folder).stat().st_size)
    cache.clear("kind")
    assert cache.load("kind", KEY) is None and cache.load("other", KEY)


@pytest.mark.parametrize("name", ["tessar.npz", "notes", 63 * "0", 64 * "g"])
def test_foreign_files_in_the_folder_are_not_removed(folder, name):
    """Users may name a folder that already contains such files."""
    cache.store("kind", KEY, b"some", 2000)
    (folder / "kind" / name).write_bytes(bytes(5000))
    cache.store("kind", OTHER, b"some", 2000)
    assert cache.size_bytes("kind")[0] == 2
    cache.clear("kind")
    assert [path.name for path in (folder / "kind").iterdir()] == [name]


def test_content_larger_than_the_limit_is_not_stored(folder):
    cache.store("kind", KEY, bytes(1000), 500)
    assert cache.size_bytes("kind") == (0, 0)


def test_another_build_loads_nothing_and_removes_nothing(folder, monkeypatch):
    cache.store("kind", KEY, b"some", 2000)
    with monkeypatch.context() as patched:
        patched.setattr(cache, "build_identity", lambda: "another")
        assert cache.load("kind", KEY) is None
        cache.store("kind", KEY, b"other", 2000)
        assert cache.load("kind", KEY) == b"other"
    assert cache.load("kind", KEY) == b"some"


@pytest.mark.parametrize("word", ["off", "OFF"])
def test_it_can_be_turned_off(word, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("LENSFIELD_CACHE", word)
    cache.store("kind", KEY, b"some", 2000)
    assert cache.load("kind", KEY) is None and not list(tmp_path.iterdir())


def a_file(path):
    path.write_text("no folder")


def a_circle(path):
    path.symlink_to(path)


def a_folder_in_the_way(path):
    cache._path(path, "kind", KEY).mkdir(parents=True)


@pytest.mark.parametrize("obstruct", [a_file, a_circle, a_folder_in_the_way])
def test_an_unwritable_folder_stores_nothing_and_causes_no_error(folder, obstruct):
    try:
        obstruct(folder)
    except (OSError, NotImplementedError):
        pytest.skip("a system without links")
    cache.store("kind", KEY, b"some", 2000)
    assert cache.load("kind", KEY) is None


def test_a_read_only_folder_can_be_read(folder):
    cache.store("kind", KEY, b"some", 2000)
    (folder / "kind").chmod(0o555)
    try:
        cache.store("kind", OTHER, b"some", 2000)  # root may write there
        assert cache.load("kind", KEY) == b"some"
    finally:
        (folder / "kind").chmod(0o755)


def test_a_full_disk_leaves_nothing_half_written(folder, monkeypatch):
    def full(path, content):
        with open(path, "wb") as file:
            file.write(content[:3])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    cache.store("kind", KEY, b"some", 2000)
    assert cache.load("kind", KEY) is None and not list((folder / "kind").iterdir())


WRITE_AND_READ = """
from lensfield.engine.runtime import cache
for turn in range(100):
    key = content = bytes([turn % 5] * 32)
    cache.store("kind", key, 100 * content, 10000)
    assert cache.load("kind", key) in (None, 100 * content)  # another process may think it the oldest
"""


def test_processes_share_the_cache(folder):
    processes = [subprocess.Popen([sys.executable, "-c", WRITE_AND_READ]) for _ in range(3)]
    assert [process.wait(LAST_RESORT_S) for process in processes] == [0, 0, 0]


def test_the_environment_overrides_the_folder_set_by_the_program(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "_configured", {})
    monkeypatch.delenv("LENSFIELD_CACHE")
    cache.set_cache_folder(tmp_path / "own")
    assert cache.cache_folder() == tmp_path / "own"
    monkeypatch.setenv("LENSFIELD_CACHE", str(tmp_path / "asked"))
    assert cache.cache_folder() == tmp_path / "asked"


@pytest.mark.parametrize("system, environment, folder", [
    ("linux", {"HOME": "/home/me"}, "/home/me/.cache/lensfield"),
    ("linux", {"HOME": "/home/me", "XDG_CACHE_HOME": "/scratch/me"}, "/scratch/me/lensfield"),
    ("linux", {"HOME": "/home/me", "XDG_CACHE_HOME": "not/absolute"}, "/home/me/.cache/lensfield"),
    ("linux", {"HOME": "nowhere"}, None),
    ("darwin", {"HOME": "/Users/me"}, "/Users/me/Library/Caches/lensfield"),
    ("win32", {"LOCALAPPDATA": os.path.abspath("/local")}, os.path.abspath("/local/lensfield")),
    ("win32", {}, None),
])
def test_the_default_folder_follows_the_system(system, environment, folder, monkeypatch):
    if os.name == "nt" and system != "win32":
        pytest.skip("another system's paths")
    for name in ("LENSFIELD_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(cache, "_configured", {})
    monkeypatch.setattr(sys, "platform", system)
    assert cache.cache_folder() == (folder and Path(folder))
