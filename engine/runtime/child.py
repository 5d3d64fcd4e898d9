"""A command in a child process that cannot outlive its parent.

The child reports progress on its standard output (`messages.py`), and ends when its standard input closes, which
requires the option `--end-with-stdin`. On every system, standard input closes when the parent ends for any reason.
"""

import json
import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from .files import AnyPath
from .messages import STOP, read_message

GRACE_S = 0.7  # for a child to remove half-written files
CRASH = "Writing: "  # Blender's last line in a crash, with the path of a file that is added to the log


class Child:
    """A running command.

    Parameters
    ----------
    command : list of str
    folder : path
        For its temporary files and its log.
    hear : callable (facts), optional
        Called with each message, in a separate thread.

    Attributes
    ----------
    status : dict
        The latest value of each fact in its messages: fraction and label, lens_image; at the end messages, or error.
    lens_images : list of str
        Lens images of the finished frames, in the order reported.
    status_s : float
        Time of the latest message, by time.monotonic().
    log : Path
    """

    def __init__(self, command: Sequence[str], folder: AnyPath,
                 hear: Callable[[dict[str, Any]], object] | None = None) -> None:
        self._hear, self.status_s = hear, time.monotonic()
        self.status: dict[str, Any] = {}
        self.lens_images: list[str] = []
        self.log = Path(folder) / "render.log"
        self._log = open(self.log, "a", buffering=1, encoding="utf-8")
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, encoding="utf-8",
            errors="replace", env=os.environ | dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(folder)),
            start_new_session=True, creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0))
        assert self._process.stdin and self._process.stdout, "both are pipes"
        self._requests, self._messages = self._process.stdin, self._process.stdout
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self._messages:
            facts = read_message(line)
            if facts is None:
                with suppress(OSError):  # on a full disk, continue to receive messages
                    self._log.write(line)
            else:
                self.status, self.status_s = self.status | facts, time.monotonic()
                self.lens_images += [facts["lens_image"]] if "lens_image" in facts else []
                if self._hear:
                    self._hear(facts)

    def ask(self, arguments: Sequence[str]) -> None:
        """Let `lensfield serve` run a command; it reports a status at the end."""
        self.status = {}
        self._write(arguments)

    def stop(self) -> None:
        """Let `lensfield serve` stop its command, which then reports its status."""
        self._write(STOP)

    def _write(self, request):
        with suppress(OSError):  # the process has ended, which `ended` shows
            print(json.dumps(request), file=self._requests, flush=True)

    @property
    def ended(self) -> bool:
        """Whether the process has ended by itself."""
        return self._process.poll() is not None

    def ended_within(self, seconds: float) -> bool:
        """Whether the process ends by itself within a time."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
        return self.ended

    def end(self) -> None:
        """End the process within GRACE_S, if it is still running.

        Afterwards all of its processes have ended and all of its messages have been received.
        """
        with suppress(OSError):  # a request that it can no longer read
            self._requests.close()
        try:
            self._process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._kill_workers()
        self._reader.join()
        self._messages.close()
        with suppress(OSError):  # the rest of the log, on a full disk
            self._log.close()

    def _kill_workers(self):
        """Kill the workers of a crashed process, which would wait forever and keep its standard output open."""
        if hasattr(os, "killpg"):
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)

    def death(self) -> tuple[str, str]:
        """Why the process ended without reporting success or an error, and a lasting copy of its log: two strings."""
        lines = [line.strip() for line in self.log.read_text(encoding="utf-8", errors="replace").split("\n")]
        last = next((line for line in reversed(lines) if line and not line.startswith(CRASH)), "no output")
        code = self._process.returncode
        return f"{f'signal {-code}' if code < 0 else f'exit status {code}'}: {last}", self._saved_log()

    def _saved_log(self):
        """Copy the log and Blender's crash reports to a lasting file; returns its path, or why copying failed."""
        copy = tempfile.NamedTemporaryFile(prefix="lensfield-", suffix=".log", delete=False)
        try:
            with copy:
                for path in (self.log, *self.log.parent.glob("*.crash.txt")):
                    copy.write(path.read_bytes())
        except OSError as error:
            os.unlink(copy.name)
            return f"lost ({error.strerror})"
        return copy.name
