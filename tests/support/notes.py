"""The names that a reader's notes list as unread."""

import re

from lensfield.engine.runtime.unread import unread_note

NOTE = re.compile(re.escape(unread_note(["NAMES"])).replace("NAMES", "(.*)"))


def unread(notes):
    """The names as the notes list them, separated by commas; "" for none."""
    found = NOTE.search(notes)
    return found[1] if found else ""
