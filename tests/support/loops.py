"""Choose the loops that a test uses."""

import os
from contextlib import AbstractContextManager
from unittest import mock

from lensfield.engine.kernels import library


def using(name: str) -> AbstractContextManager:
    """Use the loops of this name, one of `available`, in this process until the block ends."""
    return mock.patch.dict(os.environ, {library.VARIABLE: name})
