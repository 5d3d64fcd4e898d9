"""The `lensfield` command line. Each subcommand is a module of `commands`.

Signal handlers are installed before large imports: this module loads only small parts of the standard library, and
functions import everything else when they need it.
"""

import os
import signal
import sys
from contextlib import suppress

from . import __version__

CANCELLED = 130
UNHEARD = 141  # a shell's exit status for a program ended by SIGPIPE
LONGEST_HEARD_BYTES = 1 << 20
STOPS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


def main(arguments=None):
    """Run the command and return its exit status: 0 or the subcommand's status, 1 for bad input (one line), 2 for
    a usage error.

    If the reader of the output closes it, as `head` does, the command ends silently.
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
    """Redirect broken streams to the null device, so that buffered output cannot raise errors at exit."""
    for stream in (sys.stdout, sys.stderr):
        try:
            print(end="", file=stream, flush=True)
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _run(arguments):
    try:
        options = _parser().parse_args(arguments)
    except SystemExit as stop:  # inside Blender, the process must not end
        return stop.code or 0
    return _run_command(options, sys.argv[1:] if arguments is None else arguments)


def _run_command(options, arguments):
    from lensfield.engine.runtime.errors import one_line, shown

    from .commands.farm_log import FARM_LOGS
    from .commands.outcome import FAILURES
    from .commands.parser import LONGEST_LINE
    from .commands.untrusted import run

    if getattr(options, "end_with_stdin", False):
        _end_with_stdin(getattr(options, "hear", None))
    if getattr(options, "progress", None) in FARM_LOGS:
        _end_unread()
    try:
        status = run(options, arguments)
    except BrokenPipeError:
        raise
    except FAILURES as error:
        print(end="", flush=True)  # if standard output fails, report that instead
        print(f"lensfield: {shown(one_line(error), LONGEST_LINE)}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("lensfield: cancelled", file=sys.stderr)
        return CANCELLED
    return status or 0


def _parser():
    from .commands.parser import command_parser

    return command_parser(main, __version__)


def console():
    """Entry point of the console script, which may end its process."""
    _open_closed_streams()
    _stop_on_signals()
    _leave(main())


def _open_closed_streams():
    """Open closed standard streams, as daemons leave them, on the null device."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            setattr(sys, name, os.fdopen(number, "r" if number == 0 else "w"))


def _stop_on_signals():
    """Let Ctrl-C, SIGTERM and SIGHUP (unless ignored, as by `nohup`) end the process at once, without half-written
    files.

    An exception is not enough: Python raises it only when the main thread returns from C++, minutes later, and
    Blender's callbacks lose it. The wakeup descriptor receives a byte as soon as a signal arrives, and a thread waits
    for it.
    """
    if os.name == "nt":  # Windows pipes do not support this; Ctrl-C ends the process there anyway
        return
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer)
    for number in STOPS:
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, lambda *_: None)

    from lensfield.engine.runtime.waiting import wait_in_thread  # signals meanwhile wait in the pipe

    def wait():
        os.read(reader, 1)
        _cancel()

    wait_in_thread(wait, "signals")


def _end_with_stdin(hear):
    """End the process at once, without half-written files, when its standard input closes: when its parent closes it,
    or ends. Until then, pass each line to `hear`, if given.

    Does nothing if the thread already exists, as for a command that `serve` runs.
    """
    from lensfield.engine.runtime.waiting import wait_in_thread

    def wait():
        with open(0, "rb", closefd=False) as stream:
            for line in _lines(stream):
                if hear:
                    hear(line)
        _cancel()

    wait_in_thread(wait, "standard input")


def _lines(stream):
    """The lines of a stream of bytes, each truncated to LONGEST_HEARD_BYTES + 1 bytes."""
    while line := stream.readline(LONGEST_HEARD_BYTES + 1):
        rest = line
        while rest and not rest.endswith(b"\n"):
            rest = stream.readline(LONGEST_HEARD_BYTES)
        yield line


def _end_unread():
    """End the process at once, without half-written files, when the reader of its standard output is gone, as when a
    farm's worker is killed. (Windows does not support this.)"""
    import select
    import stat

    from lensfield.engine.runtime.waiting import wait_in_thread

    if not hasattr(select, "poll") or not stat.S_ISFIFO(os.fstat(1).st_mode):
        return
    readers = select.poll()
    readers.register(os.dup(1), 0)  # a duplicate, because 1 itself is redirected at times

    def wait():
        readers.poll()
        _cancel()

    wait_in_thread(wait, "standard output")


def _cancel():
    passes_text = "".join(f"; finished passes are stored in {_printable(folder)}" for folder in _remove_pending())
    with suppress(OSError):  # standard error may be closed
        print(f"\nlensfield: cancelled{passes_text}", file=sys.stderr)
    _leave(CANCELLED)


def _remove_pending():
    """Remove all half-written files, and return the folders with passes that a render can resume from. Until
    `engine.runtime.files` is loaded, there are neither."""
    files = sys.modules.get("lensfield.engine.runtime.files")
    return getattr(files, "remove_pending", list)()


def _printable(folder):
    """The folder's path, without control characters for the terminal."""
    from lensfield.engine.runtime.errors import printable

    return printable(str(folder))


def _leave(status):
    """End the process with this status, without the interpreter's shutdown."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    if "multiprocessing.process" in sys.modules:
        import multiprocessing

        for process in multiprocessing.active_children():  # these would wait for work forever
            process.kill()
    if "bpy" in sys.modules:
        import shutil

        shutil.rmtree(sys.modules["bpy"].app.tempdir, ignore_errors=True)
    os._exit(status)  # some of Blender's wheels crash while the interpreter exits
