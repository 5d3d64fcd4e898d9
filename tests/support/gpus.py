"""Work that a graphics processor does or leaves to C."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest

from lensfield.engine.kernels.gpu import Gpu
from lensfield.engine.kernels.library import running
from loops import using


def loops() -> AbstractContextManager:
    """Use the loops that run without a graphics processor, until the block ends."""
    return using(running())


@contextmanager
def warns(gpu: Gpu, *words: str) -> Iterator[None]:
    """Assert that the block warns in a single line with these words, about the graphics processor."""
    with pytest.warns(RuntimeWarning) as caught:
        yield
    line, = caught
    assert line.filename == gpu.name and all(word in str(line.message) for word in (*words, "C is used instead"))
    assert "\n" not in str(line.message)
