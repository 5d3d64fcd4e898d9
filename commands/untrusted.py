"""`--untrusted`: run a command on files of unknown origin, in a process confined to certain folders, with limits.

The command restarts itself through `confine.py`, which limits its access to the program, the scene's folder and
`--root` (reading), and `--output` (writing). It waits for the process until the time limit. In the process,
`engine/runtime/inputs.py` checks every named file first, so a refusal is one line about a file instead of a system
error.
"""

import json
import os
import secrets
import signal
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

from lensfield.engine import InputError
from lensfield.engine.kernels.gpu import VARIABLE
from lensfield.engine.kernels.library import running
from lensfield.engine.runtime.cache import cache_folder
from lensfield.engine.runtime.files import make_folder, temporary_folder, temporary_root
from lensfield.engine.runtime.inputs import confine
from lensfield.engine.runtime.memory import available_bytes

from .arguments import TIME_LIMIT_S, check_limits
from .confine import landlock_version
from .task import lensfield_in

LONGEST_S = 1e7
GIGABYTE = 1e9
MEMORY_LIMITS_GB = 2.0, 1e6  # Blender alone needs 1.5 GB of address space
GRACE_S = 5.0  # for the command to remove half-written files
CONFINED, LIMITS = "LENSFIELD_CONFINED", "limits.json"
PACKAGE = Path(str(files(__package__))).resolve().parent
OF_SYSTEM = ("/usr", "/lib", "/lib32", "/lib64", "/bin", "/etc/ld.so.cache", "/etc/ld.so.conf", "/etc/ld.so.conf.d",
             "/etc/fonts", "/etc/localtime", "/proc", "/sys", "/dev/zero", "/dev/random", "/dev/urandom")
NOWHERE = "/dev/null"
OPTIONS = "root", "time_limit", "memory_limit"


def run(options, arguments):
    """Run a command, confined if requested, and return its exit status.

    Parameters
    ----------
    options : argparse.Namespace
        `confines`, present if the command can be confined, returns the scene or picture and the output folder.
    arguments : list of str
        The command line that was parsed into `options`.
    """
    if not getattr(options, "untrusted", False):
        for name in OPTIONS:
            if getattr(options, name, None) is not None:
                raise InputError("options", "--" + name.replace("_", "-"), "given without --untrusted", "give both")
    elif hasattr(options, "confines") and not getattr(options, "scheduler", None):  # a cluster's workers confine tasks
        if not _is_started_by_supervisor():
            return _supervise(options, arguments)
        read, write = _folders(options)
        work = temporary_root()
        confine([*read, *write, work, PACKAGE, *filter(None, [cache_folder()])], [*write, work])
    return options.run(options)


def _is_started_by_supervisor():
    """Whether `_supervise` started this process: the environment and the process's own folder then have one token."""
    token = os.environ.pop(CONFINED, "")
    try:
        limits = json.loads(Path(temporary_root(), LIMITS).read_text(encoding="utf-8"))
        return bool(token) and limits["token"] == token
    except (OSError, ValueError, TypeError, KeyError):
        return False


def _folders(options):
    """The folders to read from and the folders to write to: two lists."""
    first, output = options.confines(options)
    return [first.absolute().parent, *map(Path.absolute, options.root or ())], [output.absolute()] if output else []


def _supervise(options, arguments):
    """Run the command again in a confined process, and return its exit status.

    Raises
    ------
    InputError
        --output is missing, or the process reached a limit.
    """
    time_s = TIME_LIMIT_S if options.time_limit is None else options.time_limit
    check_limits("--time-limit", time_s, (1.0, LONGEST_S))
    memory_gb = options.memory_limit
    if memory_gb is None:
        memory_gb = available_bytes() / GIGABYTE
    else:
        check_limits("--memory-limit", memory_gb, MEMORY_LIMITS_GB)
    what, (read, write) = options.confines(options)[0], _folders(options)
    for folder in write:
        make_folder(folder)
    if not landlock_version():
        print("untrusted: this system cannot confine a process (Landlock): only files that the scene names are "
              "checked", file=sys.stderr)
    with temporary_folder() as work:
        token = secrets.token_hex()
        limits = {"token": token, "read": [*_program(), *read, NOWHERE], "write": [work, *write, NOWHERE],
                  "memory_bytes": int(memory_gb * GIGABYTE), "cpu_s": int(time_s * (os.cpu_count() or 1)) + 1}
        path = work / LIMITS
        path.write_text(json.dumps(limits, default=str), encoding="utf-8")
        status = _wait(_start([str(path), *_command(), *arguments], work, token), what, time_s)
    if status < 0:
        raise InputError(what, "process", f"ended by {signal.Signals(-status).name}",
                         f"it may have reached the memory limit of {memory_gb:.3g} GB: --memory-limit")
    return status


def _program():
    """The program's files and folders, and its cache."""
    folders = {sys.prefix, sys.base_prefix, sys.exec_prefix, *filter(os.path.isabs, sys.path)}
    if blender := _blender():
        import bpy

        folders |= {os.path.dirname(blender), *map(bpy.utils.resource_path, ("USER", "LOCAL", "SYSTEM"))}
    return [*OF_SYSTEM, *sorted(filter(None, folders)), PACKAGE, *filter(None, [cache_folder()])]


def _blender():
    """The Blender executable of this process; "" for the wheel."""
    bpy = sys.modules.get("bpy")
    return bpy.app.binary_path if bpy else ""


def _command():
    first, *more = lensfield_in(_blender() or None)
    return [first, "--disable-autoexec", *more] if _blender() else [first, *more]


def _start(command, work, token):
    """Start the process, with `work` as its temporary folder."""
    if os.name == "posix":
        command = [sys.executable, "-I", str(PACKAGE / "commands" / "confine.py"), *command]
    else:
        command = command[1:]
    environment = os.environ | {CONFINED: token, VARIABLE: running()}  # without a GPU, whose driver is not confined
    return subprocess.Popen(command, env=environment | dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(work)),
                            start_new_session=sys.platform == "linux")  # elsewhere, Ctrl-C must reach it


def _wait(process, what, time_s):
    """The exit status of a process; raises an InputError at the time limit."""
    try:
        return process.wait(time_s)
    except subprocess.TimeoutExpired:
        process.terminate()
        raise InputError(what, "time limit", f"{time_s:g} s", "exceeded: --time-limit") from None
    finally:
        _end(process)


def _end(process):
    """End the process and, on Linux, all processes that it started."""
    try:
        process.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if sys.platform == "linux":
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
