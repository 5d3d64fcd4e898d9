"""What a command tells the program that started it: lines on standard output, of a mark and a JSON object each.

    lensfield> {"fraction": 0.42, "label": "Pass 2 of 3: 500 to 560 nm"}    how far it is
    lensfield> {"lens_image": "/renders/Scene_0001_lens_image.exr", "frame": 1, "seconds": 61.5}    a frame is there
    lensfield> {"told": ["...", "..."]}    it is done
    lensfield> {"error": "camera 'Camera': type is ORTHO: expected a perspective camera"}    it is not, and why

Blender and its libraries write on standard output too; lines without the mark are theirs. A process that ends with
neither of the last two has died.
"""

import json
import os
import sys
import time
from contextlib import contextmanager

MARK = "lensfield> "
PACE_S = 0.1  # between two lines of one label, where each new one is told at once
ENOUGH = 0.03  # of the work, to tell by its time what is left: of 31 wavelengths the first


@contextmanager
def message_lines():
    """A function that writes a message of the facts that it is given, at once.

    Meanwhile standard output is its alone: what others write there goes to standard error.
    """
    sys.stdout.flush()
    descriptor = os.dup(1)
    os.dup2(2, 1)
    try:
        with open(descriptor, "w", encoding="ascii", closefd=False) as lines:
            yield lambda **facts: print(MARK + json.dumps(facts), file=lines, flush=True)
    finally:
        sys.stdout.flush()
        os.dup2(descriptor, 1)
        os.close(descriptor)


def paced(write, pace_s=PACE_S, new_label_s=0.0):
    """A progress function (fraction, label) that writes not each of a thousand samples, but each new label; or not
    even that, where so many seconds have not passed."""
    last = {"label": None, "s": 0.0}

    def tell(fraction, label):
        now = time.monotonic()
        if now - last["s"] >= (pace_s if label == last["label"] else new_label_s):
            last.update(label=label, s=now)
            write(fraction=fraction, label=label)

    return tell


def time_left(fraction, spent_s, since_s=0.0):
    """How long the rest will take, by how long this fraction took and how long ago that was; "" where it is too little
    to tell."""
    return f"{duration(max(spent_s * (1 / fraction - 1) - since_s, 0))} left" if fraction >= ENOUGH else ""


def duration(seconds):
    """So many seconds in a few letters."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def read_message(line):
    """The facts of a line; None where it is not one of ours."""
    _, mark, message = line.partition(MARK)  # after what a library has written without ending its line
    try:
        facts = json.loads(message) if mark else None
    except ValueError:
        return None
    return facts if isinstance(facts, dict) else None
