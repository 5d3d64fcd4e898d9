"""Messages from a command to the program that started it: lines on standard output, each a mark and a JSON object.

    lensfield> {"fraction": 0.42, "label": "Pass 2 of 3: 500 to 560 nm"}    progress
    lensfield> {"lens_image": "/out/shot_Scene_0001_lens_image.exr", "frame": 1, "seconds": 61.5}    a finished frame
    lensfield> {"picture": "/tmp/S_0001_lens_image.exr", "size_px": [480, 270], "samples": 4, "number": 2}    a preview
    lensfield> {"messages": ["...", "..."]}    success, with remarks; from compare also "sheet", the path of the contact
                                               sheet, and "cells": for each picture its lens, f_number, label and box
    lensfield> {"error": "camera 'Camera': type is ORTHO: expected a perspective camera"}    failure, with the reason

Blender and its libraries also write to standard output, in lines without the mark. A process that ends without one of
the last two messages has crashed.
"""

import io
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from typing import Any

MARK = "lensfield> "
STOP = "stop"  # a line to `serve`: stop the running command
PACE_S = 0.1  # between lines with the same label; a new label is written immediately
ENOUGH = 0.03  # fraction of the work needed to estimate the remaining time: the first of 31 wavelengths


class _Log(io.FileIO):
    """A file whose lines are lost if the disk is full."""

    def write(self, content: Any, /) -> int:
        with suppress(OSError):
            return super().write(content)
        return len(content)


@contextmanager
def message_lines() -> Iterator[Callable[..., object]]:
    """A function that writes facts as a message immediately.

    Within the context, all other output to standard output goes to standard error, which is a log: the command does not
    depend on it.
    """
    sys.stdout.flush()
    descriptor = os.dup(1)
    os.dup2(2, 1)
    try:
        with (io.TextIOWrapper(_Log(2, "w", closefd=False), "utf-8", "backslashreplace", write_through=True) as log,
              redirect_stdout(log), redirect_stderr(log),
              open(descriptor, "w", encoding="ascii", closefd=False) as lines):
            yield lambda **facts: print(MARK + json.dumps(facts), file=lines, flush=True)
    finally:
        sys.stdout.flush()
        os.dup2(descriptor, 1)
        os.close(descriptor)


def paced(write: Callable[..., object], pace_s: float = PACE_S,
          new_label_s: float = 0.0) -> Callable[[float, str], None]:
    """A progress function (fraction, label) that limits the rate of messages.

    A message with the same label as the last one is written only after `pace_s`, one with a new label only after
    `new_label_s`.
    """
    last: dict[str, Any] = {"label": None, "s": 0.0}

    def on_progress(fraction: float, label: str) -> None:
        now = time.monotonic()
        if now - last["s"] >= (pace_s if label == last["label"] else new_label_s):
            last.update(label=label, s=now)
            write(fraction=fraction, label=label)

    return on_progress


def time_left(fraction: float, spent_s: float, since_s: float = 0.0) -> str:
    """Format the remaining time, from the seconds spent on this fraction and the seconds since then; "" if the fraction
    is too small for an estimate."""
    return f"{duration(max(spent_s * (1 / fraction - 1) - since_s, 0))} left" if fraction >= ENOUGH else ""


def duration(seconds: float) -> str:
    """Format a duration briefly."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def read_message(line: str) -> dict[str, Any] | None:
    """The facts in a line, or None if it is not a message."""
    _, mark, message = line.partition(MARK)  # a library's unfinished line may precede the mark
    try:
        facts = json.loads(message) if mark else None
    except ValueError:
        return None
    return facts if isinstance(facts, dict) else None
