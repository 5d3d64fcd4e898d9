"""A simulated full disk: a limit on the size of files."""

from contextlib import contextmanager

import pytest


@contextmanager
def room_for(size_bytes):
    """Limit the size of this process's files; writes beyond it fail with `File too large`."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
