"""What users are told: one line, never long, in which every character shows."""

import pickle

import numpy as np
import pytest

from lensfield.engine import InputError, LensError
from lensfield.engine.errors import MOST_SHOWN, printable, shown

ESCAPE = "\x1b]0;owned\x07\x1b[31mred\u202e\udcff\x00\r\n\tend"


def nested(depth):
    """A list in a list in a list ..."""
    value = []
    for _ in range(depth):
        value = [value]
    return value


def test_a_short_error_stands_as_it_is():
    assert str(InputError("lens.toml", "efl_mm", -6.0, "expected more")) == "lens.toml: efl_mm is -6.0: expected more"
    assert str(InputError("lens.toml", "name", "", "expected a text")) == "lens.toml: name is empty: expected a text"


@pytest.mark.parametrize("part", ["where", "field", "value", "remedy"])
@pytest.mark.parametrize("text", [ESCAPE, "x" * 10**6, ESCAPE * 10**4, "a\n" * 10**5], ids=["steers", "long", "both",
                                                                                       "lines"])
def test_every_part_is_one_printable_line_and_short(part, text):
    parts = dict(where="lens.toml", field="name", value="x", remedy="expected another") | {part: text}
    for error in (LensError(**parts), LensError(**parts).at(text), pickle.loads(pickle.dumps(LensError(**parts)))):
        assert str(error).isprintable() and len(str(error)) < sum(MOST_SHOWN.values()) + 10
        assert all(getattr(error, name).isprintable() for name in parts)


@pytest.mark.parametrize("value", [nested(10**5), 16**10**5, list(range(10**6)), np.zeros(10**6), {ESCAPE: ESCAPE}],
                         ids=["deep", "digits", "list", "array", "dict"])
def test_values_that_are_no_texts_are_shown_shortly_too(value):
    told = str(InputError("lens.toml", "name", value, "expected a text"))
    assert told.isprintable() and len(told) < MOST_SHOWN["value"] + 50


def test_what_is_long_is_cut_in_the_middle():
    assert shown("begin" + "x" * 100 + "end", 20) == "beginxxx...xxxxxxend" and len(shown("x" * 100, 20)) == 20
    assert shown("x" * 20, 20) == "x" * 20
    assert shown("½ mm – größer") == "½ mm – größer"


def test_line_ends_of_longer_texts_stay():
    assert printable("one\ntwo\x1b[0m\tthree") == "one\ntwo?[0m three"
