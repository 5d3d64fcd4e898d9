"""The progress of a command: on a terminal, or as messages to the program that started it."""

from contextlib import contextmanager

from lensfield.engine.runtime.errors import one_line
from lensfield.engine.runtime.messages import message_lines, paced

from .farm_log import FARM_LOGS, PACE_S, farm_log
from .outcome import FAILURES
from .terminal import progress_bar, quiet


def add_progress_options(group):
    """Add the arguments for programs that start a command and follow it."""
    group.add_argument("--progress", choices=("bar", "lines", *FARM_LOGS), default="bar",
                       help="bar: a bar, on a terminal; lines: messages on standard output "
                            "(engine/runtime/messages.py); openjd, flamenco: messages for these farms, ending when "
                            "standard output loses its reader (default: bar)")
    group.add_argument("--end-with-stdin", action="store_true",
                       help="end as soon as standard input closes, as when its writer ends, without half-written files")


@contextmanager
def messages(options):
    """A function that writes facts as messages, if `--progress` requests them; also writes errors."""
    if options.progress == "bar":
        yield lambda **facts: None
        return
    with farm_log(FARM_LOGS[options.progress]) if options.progress in FARM_LOGS else message_lines() as write:
        try:
            yield write
        except FAILURES as error:
            write(error=one_line(error))
            raise


@contextmanager
def progress(options, write):
    """A progress function (fraction, label), as `--progress` requests."""
    if options.progress == "lines":
        yield paced(write)
    elif options.progress in FARM_LOGS:
        with quiet(1):
            yield paced(write, PACE_S, PACE_S)
    else:
        with progress_bar() as on_progress, quiet(1):
            yield on_progress
