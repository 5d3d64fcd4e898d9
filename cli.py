"""The `lensfield` command: parses and calls. Each subcommand is a module of `commands`."""

import argparse
import multiprocessing
import os
import select
import shutil
import signal
import stat
import sys
import threading
from contextlib import suppress

from . import __version__
from .commands import apply, farm, filter, lens, lint, render, serve, tradeoff
from .commands.farm_log import FARM_LOGS
from .commands.outcome import FAILURES
from .engine.errors import InputError, shown
from .engine.files import remove_pending
from .engine.kernels import running

CANCELLED = 130
UNHEARD = 141  # what a shell gives a program that SIGPIPE ends
LONGEST_LINE = 1000  # characters of an error, the system's own included


def main(arguments=None):
    """Run the command; the exit status: 0 or the runner's, 1 for bad input (told in one line), 2 for a usage error.

    When whoever reads the output has had enough, as `head` has, the command ends without a word.
    """
    try:
        status = _run(arguments)
        print(end="", flush=True)
        return status
    except BrokenPipeError:
        _send_broken_streams_nowhere()
        return UNHEARD
    except OSError as error:  # a full disk, say
        _send_broken_streams_nowhere()
        print(f"lensfield: standard output: {error.strerror}", file=sys.stderr)
        return 1


def _send_broken_streams_nowhere():
    """Let what is still to be written, and flushed at the end, go where nothing breaks."""
    for stream in (sys.stdout, sys.stderr):
        try:
            print(end="", file=stream, flush=True)
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _run(arguments):
    try:
        options = _parser().parse_args(arguments)
    except SystemExit as stop:  # inside Blender the process is not ours to end
        return stop.code or 0
    if getattr(options, "end_with_stdin", False):
        _end_with_stdin(getattr(options, "hear", None))
    if getattr(options, "progress", None) in FARM_LOGS:
        _end_unread()
    try:
        status = options.run(options)
    except BrokenPipeError:
        raise
    except FAILURES as error:
        print(end="", flush=True)  # where it is standard output that fails, that is to be told
        print(f"lensfield: {shown(str(error), LONGEST_LINE) or type(error).__name__}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("lensfield: cancelled", file=sys.stderr)
        return CANCELLED
    return status or 0


def console():
    """Entry point of the console script, whose process is its own."""
    _open_closed_streams()
    _stop_on_signals()
    _leave(main())


def _open_closed_streams():
    """Daemons start programs with standard streams closed: let what is written there go nowhere."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            setattr(sys, name, open(number, "r" if number == 0 else "w"))


def _stop_on_signals():
    """Let Ctrl-C and SIGTERM end the process at once and leave nothing behind.

    An exception would not do: Python raises it when the main thread is back from C++, minutes later, and Blender's
    own callbacks lose it. But a byte is written as soon as a signal comes, and a thread can wait for that.
    """
    if os.name == "nt":  # whose pipes cannot do this; there Ctrl-C ends the process as it is
        return
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)

    def wait():
        os.read(reader, 1)
        _cancel()

    threading.Thread(target=wait, daemon=True).start()


def _end_with_stdin(hear):
    """End the process at once, and leave nothing behind, when whoever started it closes its standard input or ends;
    until then let each line be heard, if somebody listens."""
    def wait():
        with open(0, encoding="utf-8", closefd=False) as lines:
            for line in lines:
                if hear:
                    hear(line)
        _cancel()

    threading.Thread(target=wait, daemon=True).start()


def _end_unread():
    """End the process at once, and leave nothing behind, when nobody reads its standard output any more: the worker
    of a farm that was killed has left it alone. (Windows does not tell.)"""
    if not hasattr(select, "poll") or not stat.S_ISFIFO(os.fstat(1).st_mode):
        return
    readers = select.poll()
    readers.register(os.dup(1), 0)  # which is for good, while 1 itself is sent elsewhere at times

    def wait():
        readers.poll()
        _cancel()

    threading.Thread(target=wait, daemon=True).start()


def _cancel():
    kept = "".join(f"; finished passes are kept in {folder}" for folder in remove_pending())
    with suppress(OSError):  # where nobody reads it
        print(f"\nlensfield: cancelled{kept}", file=sys.stderr)
    _leave(CANCELLED)


def _leave(status):
    """End the process with this status, whatever the interpreter's own end would come to."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    for process in multiprocessing.active_children():  # who would wait for work for ever
        process.kill()
    if "bpy" in sys.modules:
        shutil.rmtree(sys.modules["bpy"].app.tempdir, ignore_errors=True)
    os._exit(status)  # some of Blender's wheels crash while the interpreter exits, after all is done


class _Version(argparse.Action):
    def __call__(self, parser, *_):
        try:
            print(f"lensfield {__version__} (inner loops: {running()})")
        except InputError as error:
            parser.error(str(error))
        parser.exit()


def _parser():
    parser = argparse.ArgumentParser(prog="lensfield", description="Blender scenes through real lenses.")
    parser.add_argument("--version", action=_Version, nargs=0, help="the version, and what does the engine's loops")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in (render, apply, filter, tradeoff, lens, lint, farm):
        command.add(commands)
    serve.add(commands, main)
    return parser
