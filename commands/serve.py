"""`lensfield serve`: one command after another in one process, for a program that starts it once and then asks often.

It reads lines of standard input, each a JSON list of the arguments of a command, such as
`["apply", "Scene_0001_radiance.exr", "--lens", "tessar-50mm", "--progress", "lines"]`, and tells the exit status of
each by a message (`messages.py`). It ends as soon as standard input does.
"""

import json
from queue import SimpleQueue

from .messages import message_lines


def add(commands, main):
    """Add the command; `main(arguments)` runs one of the others."""
    serve = commands.add_parser("serve", help="run the commands that come by standard input, for programs",
                                description="Run the commands that come by standard input: lines of a JSON list of "
                                            "arguments each. End as soon as standard input does.")
    lines = SimpleQueue()
    serve.set_defaults(run=lambda options: _serve(lines, main), end_with_stdin=True, hear=lines.put)


def _serve(lines, main):
    while True:
        status = main(json.loads(lines.get()))
        with message_lines() as write:
            write(status=status)
