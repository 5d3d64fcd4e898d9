"""Choice of the loops that a test runs with."""

import os
from contextlib import AbstractContextManager
from unittest import mock

from lensfield.engine.kernels import library


def using(name: str) -> AbstractContextManager:
    """Use the given one of the `available` loops in this process, until the block ends."""
    return mock.patch.dict(os.environ, {library.VARIABLE: name})
