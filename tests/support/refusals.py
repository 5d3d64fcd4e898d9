"""Refusals of bad input: which field of which thing is at fault, in whatever words.

One test of each message asserts its words, by `match`; the others assert fields, so a new wording changes one test.
"""

from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def refused(kind, *, field, value=None, where=None, match=None):
    """Require that the block raises an InputError about a field, in one line of text; gives pytest's record of it.

    Parameters
    ----------
    kind : type
        The class of the error.
    field : str
    value : object, optional
        The rejected value, or a function that is true of it.
    where : str, optional
        The object or option at fault, or the name of the file without its folder.
    match : str, optional
        A regular expression for the message.
    """
    with pytest.raises(kind, match=match) as caught:
        yield caught
    error = caught.value
    assert str(error).isprintable()
    assert error.field == field, f"expected the field {field!r}: {error}"
    if value is not None:
        assert value(error.value) if callable(value) else error.value == value, f"expected another value: {error}"
    if where is not None:
        assert where in (error.where, Path(error.where).name), f"expected it in {where!r}: {error}"
