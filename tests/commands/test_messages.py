"""Messages from a command to the program that started it."""

import os
import subprocess
import sys

import pytest

from lensfield.engine.runtime import messages

SPEAKER = """
import os
from lensfield.engine.runtime.messages import message_lines
os.write(1, b"Blender says hello")
with message_lines() as write:
    os.write(1, b"chatter amid")
    print("a library prints")
    write(fraction=0.5, label="Pass 1 of 2: 450 nm \\u00b5")
print("afterwards")
"""


def test_messages_are_intact_among_other_output():
    completed = subprocess.run([sys.executable, "-c", SPEAKER], capture_output=True, text=True, check=True)
    lines = completed.stdout.splitlines()
    assert [messages.read_message(line) for line in lines] == [
        {"fraction": 0.5, "label": "Pass 1 of 2: 450 nm \u00b5"}, None]
    assert lines[0].startswith("Blender says hello") and lines[1] == "afterwards"
    assert "chatter amid" in completed.stderr and "a library prints" in completed.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full on this system")
def test_a_command_goes_on_without_room_for_its_log():
    with open("/dev/full", "wb") as full:
        completed = subprocess.run([sys.executable, "-c", SPEAKER.replace("os.write(1, b\"chatter amid\")", "")],
                                   stdout=subprocess.PIPE, stderr=full, text=True, check=True)
    assert "lensfield> " in completed.stdout and completed.stdout.endswith("afterwards\n")


@pytest.mark.parametrize("line", ["", "Fra:1 Mem:12M", "lensfield> ", "lensfield> {broken", "lensfield> [1]", "{}"])
def test_other_lines_are_ignored(line):
    assert messages.read_message(line) is None


def test_fractions_are_throttled_and_labels_sent_at_once(monkeypatch):
    now = iter([10.0, 10.01, 10.05, 10.12, 10.13])
    monkeypatch.setattr(messages.time, "monotonic", lambda: next(now))
    sent = []
    report = messages.paced(lambda **facts: sent.append((facts["fraction"], facts["label"])))
    for fraction, label in ((0.0, "a"), (0.1, "a"), (0.2, "a"), (0.3, "a"), (0.4, "b")):
        report(fraction, label)
    assert sent == [(0.0, "a"), (0.3, "a"), (0.4, "b")]


def test_durations_are_short():
    texts = [messages.duration(seconds) for seconds in (0.4, 89, 100, 4000, 8000)]
    assert texts == ["0 s", "89 s", "2 min", "67 min", "2.2 h"]


def test_the_time_left_follows_from_measured_progress():
    assert messages.time_left(0.25, 20.0) == "60 s left" and messages.time_left(0.25, 20.0, 10.0) == "50 s left"
    assert messages.time_left(1 / 31, 2.0) == "60 s left"  # after the first of 31 wavelengths
    assert messages.time_left(0.0, 20.0) == messages.time_left(0.02, 20.0) == ""
    assert messages.time_left(1, 9) == "0 s left"
