"""Messages to users: one line, never long, with every character visible."""

import errno
import os
import pickle

import numpy as np
import pytest

from lensfield.engine import InputError, LensError
from lensfield.engine.runtime.errors import MOST_SHOWN, absence, explain, one_line, printable, shown

ESCAPE = "\x1b]0;owned\x07\x1b[31mred\u202e\udcff\x00\r\n\tend"


def nested(depth):
    """A list in a list in a list ..."""
    value = []
    for _ in range(depth):
        value = [value]
    return value


def test_a_short_error_is_unchanged():
    assert str(InputError("lens.toml", "efl_mm", -6.0, "expected more")) == "lens.toml: efl_mm is -6.0: expected more"
    assert str(InputError("lens.toml", "name", "", "expected a text")) == "lens.toml: name is empty: expected a text"


@pytest.mark.parametrize("part", ["where", "field", "value", "remedy"])
@pytest.mark.parametrize("text", [ESCAPE, "x" * 10**6, ESCAPE * 10**4, "a\n" * 10**5], ids=["steers", "long", "both",
                                                                                       "lines"])
def test_every_part_is_one_short_printable_line(part, text):
    parts = dict(where="lens.toml", field="name", value="x", remedy="expected another") | {part: text}
    for error in (LensError(**parts), LensError(**parts).at(text), pickle.loads(pickle.dumps(LensError(**parts)))):
        assert str(error).isprintable() and len(str(error)) < sum(MOST_SHOWN.values()) + 10
        assert all(getattr(error, name).isprintable() for name in parts)


@pytest.mark.parametrize("value", [nested(10**5), 16**10**5, list(range(10**6)), np.zeros(10**6), {ESCAPE: ESCAPE}],
                         ids=["deep", "digits", "list", "array", "dict"])
def test_values_other_than_text_are_shortened_too(value):
    message = str(InputError("lens.toml", "name", value, "expected a text"))
    assert message.isprintable() and len(message) < MOST_SHOWN["value"] + 50


def test_long_text_is_cut_in_the_middle():
    assert shown("begin" + "x" * 100 + "end", 20) == "beginxxx...xxxxxxend" and len(shown("x" * 100, 20)) == 20
    assert shown("x" * 20, 20) == "x" * 20
    assert shown("½ mm – größer") == "½ mm – größer"


def test_line_ends_of_longer_texts_are_preserved():
    assert printable("one\ntwo\x1b[0m\tthree") == "one\ntwo?[0m three"


@pytest.mark.parametrize("path, value", [
    ("gone", "missing"), ("file/gone", "missing"), ("", "a folder"),
    ("n" * 300, "not accessible (File name too long)"),
    ("circle", "not accessible (Too many levels of symbolic links)"), ("pipe", "a device or pipe"),
    ("a\0b", "not a valid path (it contains a null character)")])
@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes in folders")
def test_the_fault_of_a_path_is_named(tmp_path, path, value):
    (tmp_path / "file").write_text("")
    (tmp_path / "circle").symlink_to(tmp_path / "circle")
    os.mkfifo(tmp_path / "pipe")
    assert absence(os.path.join(tmp_path, path)) == value


def test_system_errors_are_shown_without_numbers():
    long = OSError(errno.ENAMETOOLONG, "File name too long", "a.exr")
    assert one_line(long) == ("a.exr: file is not accessible: File name too long: give a shorter path (most file "
                              "systems allow 255 bytes per name)")
    assert one_line(OSError(errno.ENOSPC, "No space left on device")) == "No space left on device"
    assert one_line(OSError("it reads otherwise")) == explain(OSError("it reads otherwise")) == "it reads otherwise"
    assert one_line(PermissionError(errno.EACCES, "Permission denied", b"a.exr")).startswith("a.exr: file is not")
    assert one_line(MemoryError()) == "MemoryError" and one_line(InputError("a", "b", 1, "c")) == "a: b is 1: c"
