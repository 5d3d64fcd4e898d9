"""The rule for every reader: it uses each word of a file, lists it as harmless, or reports it in the lens's notes."""

from collections.abc import Collection, Iterable, Iterator
from typing import Any

from .errors import listed, shown

MOST_NAMED = 12  # words in a note


def unread_names(names: Iterable[str], known: Collection[str]) -> tuple[str, ...]:
    """The unknown names, each once, in the order of the file."""
    return tuple(dict.fromkeys(name for name in names if name not in known))


def unread_note(names: Collection[str]) -> str:
    """The note about names that a reader does not use; empty without any."""
    if not names:
        return ""
    return f"Not used from the file: {listed(map(shown, names), MOST_NAMED)}."


def json_names(value: Any, harmless: Collection[str] = ()) -> Iterator[str]:
    """All names in a JSON value, except harmless ones with their contents, and names of null, 0, false or empty."""
    if isinstance(value, list):
        for entry in value:
            yield from json_names(entry, harmless)
    elif isinstance(value, dict):
        for name, entry in value.items():
            if entry and name not in harmless:
                yield name
                yield from json_names(entry, harmless)
