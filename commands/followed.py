"""How a command tells how far it is: on a terminal, or to a program that started it and follows it."""

from contextlib import contextmanager

from .messages import message_lines, paced
from .outcome import FAILURES
from .terminal import progress_bar, quiet


def add_followed(group):
    """Arguments for programs that start a command and follow it."""
    group.add_argument("--progress", choices=("bar", "lines"), default="bar",
                       help="a bar, on a terminal; or lines on standard output (commands/messages.py says which)")
    group.add_argument("--end-with-stdin", action="store_true",
                       help="end as soon as standard input closes, as it does when its writer ends, and leave nothing "
                            "half-written")


@contextmanager
def messages(options):
    """A function that writes messages of facts, for programs that want them; an error is one, too."""
    if options.progress == "bar":
        yield lambda **facts: None
        return
    with message_lines() as write:
        try:
            yield write
        except FAILURES as error:
            write(error=str(error))
            raise


@contextmanager
def progress(options, write):
    """How to tell the progress (fraction, label)."""
    if options.progress == "lines":
        yield paced(write)
    else:
        with progress_bar() as tell, quiet(1):
            yield tell
