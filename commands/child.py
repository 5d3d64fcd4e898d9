"""A command at work in a process of its own, of which nothing outlives whoever started it.

It tells how far it is on its standard output (`messages.py`), and ends when its standard input closes (the command is
to be told so, by `--end-with-stdin`): which that does on every system, however its starter ends.
"""

import json
import os
import signal
import subprocess
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path

from .messages import read_message

GRACE_S = 0.7  # for a child to remove what is half-written
CRASH = "Writing: "  # Blender's last words, before the name of a file that comes to be in the log


class Child:
    """A command at work.

    Parameters
    ----------
    command : list of str
    folder : path
        For all that it needs for a time; its log comes to lie there too.
    hear : callable (facts), optional
        Called with each message, on a thread of its own.

    Attributes
    ----------
    told : dict
        The latest that it has told: fraction and label, lens_image; at the end told, or error.
    lens_images : list of str
        Of the frames that are there, as it told of them.
    told_s : float
        When, by time.monotonic().
    log : Path
    """

    def __init__(self, command, folder, hear=None):
        self._hear, self.told, self.lens_images, self.told_s = hear, {}, [], time.monotonic()
        self.log = Path(folder) / "render.log"
        self._log = open(self.log, "a", buffering=1, encoding="utf-8")
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, encoding="utf-8",
            errors="replace", env=os.environ | dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(folder)),
            start_new_session=True, creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0))
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self._process.stdout:
            facts = read_message(line)
            if facts is None:
                with suppress(OSError):  # a full disk: the child is heard all the same
                    self._log.write(line)
            else:
                self.told, self.told_s = self.told | facts, time.monotonic()
                self.lens_images += [facts["lens_image"]] if "lens_image" in facts else []
                if self._hear:
                    self._hear(facts)

    def ask(self, arguments):
        """Have `lensfield serve` run a command; it tells a status when it is done."""
        self.told = {}
        with suppress(OSError):  # it has ended: that is for its follower to see
            print(json.dumps(arguments), file=self._process.stdin, flush=True)

    @property
    def ended(self):
        """Whether it has ended by itself."""
        return self._process.poll() is not None

    def ended_within(self, seconds):
        """Whether it ends by itself within so many seconds."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
        return self.ended

    def end(self):
        """End it within GRACE_S, if it has not ended; nothing of it runs on, and all is heard that it told."""
        with suppress(OSError):  # of what it can no longer be asked
            self._process.stdin.close()
        try:
            self._process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._kill_workers()
        self._reader.join()
        self._process.stdout.close()
        with suppress(OSError):  # what there was no room for
            self._log.close()

    def _kill_workers(self):
        """A process that died leaves workers that wait for work for ever, its standard output open."""
        if hasattr(os, "killpg"):
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)

    def death(self):
        """Why it ended, where it told neither a picture nor an error; and a copy of its log, to be kept: two texts."""
        lines = [line.strip() for line in self.log.read_text(encoding="utf-8", errors="replace").split("\n")]
        last = next((line for line in reversed(lines) if line and not line.startswith(CRASH)), "it said nothing")
        code = self._process.returncode
        return f"{f'signal {-code}' if code < 0 else f'exit status {code}'}: {last}", self._kept_log()

    def _kept_log(self):
        """A copy of the log, with what Blender tells of a crash: its path, or why there is none."""
        kept = tempfile.NamedTemporaryFile(prefix="lensfield-", suffix=".log", delete=False)
        try:
            with kept:
                for path in (self.log, *self.log.parent.glob("*.crash.txt")):
                    kept.write(path.read_bytes())
        except OSError as error:
            os.unlink(kept.name)
            return f"lost ({error.strerror})"
        return kept.name
