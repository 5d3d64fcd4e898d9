"""`lensfield serve`: many commands in one process, for programs that start it once and send requests.

It reads lines from standard input, each a JSON list of the arguments of a command, such as
`["apply", "Shot_0001_radiance.exr", "--lens", "tessar-50mm", "--progress", "lines"]`, and reports the exit status of
each in a message (`messages.py`). The message for any other line has an error and status 2, as for a usage error. The
line `"stop"` stops the command of the line before it, if that is `preview`, without an answer.
`serve` ends when standard input closes.
"""

import json
import os
from queue import SimpleQueue

from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.messages import STOP, message_lines
from lensfield.engine.runtime.waiting import Flag

from .arguments import add_untrusted
from .parser import USAGE_ERROR
from .stopping import stoppable
from .task import arguments_of
from .untrusted import OPTIONS

EXPECTED = 'expected a JSON list of strings, such as ["lens", "info", "tessar-50mm"]'


def add_options(serve):
    serve.description = ("Run commands from standard input, each a line with a JSON list of arguments. End as soon as "
                         "standard input closes.")
    add_untrusted(serve)
    requests = Requests()
    serve.set_defaults(run=lambda options: _serve(requests, options.main, _limits(options)), end_with_stdin=True,
                       hear=requests.hear)


class Requests:
    """Lines of standard input, each with the flag that stops its command. A thread hears them."""

    def __init__(self):
        self._waiting, self._stop_last = SimpleQueue(), Flag()

    def hear(self, line):
        if line.strip() == json.dumps(STOP).encode():
            self._stop_last.set()
        else:
            self._stop_last = Flag()
            self._waiting.put((line, self._stop_last))

    def next(self):
        """Wait for a line; returns it and its flag."""
        return self._waiting.get()


def _limits(options):
    """The arguments that confine each command to a separate process; for commands that cannot be confined, they are
    usage errors."""
    if not options.untrusted:
        return []
    return ["--untrusted", *(argument for name in OPTIONS if (value := getattr(options, name)) is not None
                             for argument in arguments_of(name, value))]


def _serve(requests, main, limits):
    while True:
        line, stop = requests.next()
        try:
            with stoppable(stop):
                answer = {"status": main([*_confined(_arguments(line), limits), *limits])}
        except InputError as error:
            answer = {"error": str(error), "status": USAGE_ERROR}
        with message_lines() as write:
            write(**answer)


def _confined(arguments, limits):
    """The arguments of a command; raises an InputError if they would change the limits."""
    of_limits = [f"--{name.replace('_', '-')}" for name in OPTIONS]
    for argument in arguments if limits else ():
        word = argument.partition("=")[0]
        if len(word) > len("--") and any(option.startswith(word) for option in of_limits):  # argparse completes them
            raise InputError("serve", "option", word, "give it to serve --untrusted itself, for all of its commands")
    return arguments


def _arguments(line):
    """The arguments in a line of standard input.

    Parameters
    ----------
    line : bytes
        Lacks its line end if it was too long to be read completely.

    Returns
    -------
    list of str

    Raises
    ------
    InputError
        The line is not a JSON list of arguments, or the arguments are not valid.
    """
    if not line.endswith(b"\n"):
        raise InputError("serve", "line", f"over {len(line) - 1} bytes", EXPECTED)
    try:
        arguments = json.loads(line.decode())
    except UnicodeDecodeError:
        raise InputError("serve", "line", "not in UTF-8", EXPECTED) from None
    except (ValueError, RecursionError):
        raise InputError("serve", "line", line.decode().strip(), EXPECTED) from None
    if not isinstance(arguments, list) or not all(isinstance(each, str) for each in arguments):
        raise InputError("serve", "line", line.decode().strip(), EXPECTED)
    for number, each in enumerate(arguments):
        if not _can_be_argument(each):
            raise InputError("serve", f"argument {number}", each, "expected a string that the system can encode")
    if arguments[:1] == ["serve"]:
        raise InputError("serve", "command", "serve", "expected another command")
    return arguments


def _can_be_argument(text):
    """Whether a string could be a command-line argument: it has no null characters and no lone surrogates."""
    try:
        return b"\0" not in os.fsencode(text)
    except UnicodeEncodeError:
        return False
