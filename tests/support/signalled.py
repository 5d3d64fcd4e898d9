"""A command that receives a signal at a given import, whatever the machine's speed."""

import signal
import subprocess
import sys

AT_AN_IMPORT = """
import os, signal, sys

name, count, number = sys.argv[1], int(sys.argv[2]), getattr(signal, sys.argv[3])
del sys.argv[1:4]
seen, begun = 0, not name

def hook(event, names):
    global seen, begun
    if event == "import":
        begun = begun or names[0] == name
        seen += begun
        if begun and seen == count:
            os.kill(os.getpid(), number)

from lensfield.cli import console

sys.addaudithook(hook)
console()
"""
"""Runs the command and sends it a signal at the COUNT-th import, counted from the import of NAME if given."""


def heed_hangups():
    """Restore the default SIGHUP handler in a child before it starts: the tests may run under `nohup`."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def signalled(count, name="", arguments=("lens", "list"), signal_name="SIGINT", **more):
    """Run the command to its end and return the finished process; `more` is passed to `subprocess.run`."""
    command = [sys.executable, "-c", AT_AN_IMPORT, name, str(count), signal_name, *map(str, arguments)]
    before = {"preexec_fn": heed_hangups if hasattr(signal, "SIGHUP") else None}
    return subprocess.run(command, capture_output=True, text=True, **before | more)
