"""A disk that is full, in place of which there is a limit on the size of files."""

from contextlib import contextmanager

import pytest


@contextmanager
def room_for(size_bytes):
    """Let no file of this process grow beyond so many bytes: more is `File too large`."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
