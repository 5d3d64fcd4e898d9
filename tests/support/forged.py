"""Entries of the cache with valid seals around any content."""

from lensfield.engine.runtime import cache


def forge(folder, kind, content):
    """Replace the content of the only entry of a kind; returns its file."""
    path, = (folder / kind).iterdir()
    path.write_bytes(cache._seal(path, content) + b"\n" + content)
    return path
