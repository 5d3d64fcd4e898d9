"""A request to stop the command that `serve` is running: it ends as soon as it can, with the results so far."""

from contextlib import contextmanager

from lensfield.engine.runtime.waiting import Flag

_current = [Flag()]


@contextmanager
def stoppable(flag):
    """Let this flag stop the commands that run within the context."""
    before, _current[0] = _current[0], flag
    try:
        yield
    finally:
        _current[0] = before


def stopped():
    """Whether the running command is to stop."""
    return _current[0].is_set()
