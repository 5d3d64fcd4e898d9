"""What does the loops, for as long as a test asks."""

import os
from contextlib import AbstractContextManager
from unittest import mock

from lensfield.engine.kernels import library


def using(name: str) -> AbstractContextManager:
    """Another one of those `available`, in this process, until the block ends."""
    return mock.patch.dict(os.environ, {library.VARIABLE: name})
