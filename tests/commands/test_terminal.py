"""The progress bar on a terminal, and the remaining time that it estimates."""

import io
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from lensfield.commands import terminal
from places import ROOT


class Screen(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize("begin, wavelengths", [(0.0, 31), (0.5, 4)])  # alone, and as the second of two pictures
def test_the_first_wavelength_gives_the_time_left(begin, wavelengths, monkeypatch):
    screen, now = Screen(), iter((100.0, 100.0, 102.0))
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setattr(terminal, "time", SimpleNamespace(monotonic=lambda: next(now)))
    with terminal.progress_bar() as report:
        report(begin, "Through a lens")
        report(begin + (1 - begin) / wavelengths, "Through a lens")
    first, second, wiped = screen.getvalue().split("\r")[1:-1]
    assert "left" not in first and f"{2 * (wavelengths - 1)} s left" in second
    assert "Through a lens" in second and len(first) == len(second) == len(wiped) - 1


def test_no_bar_is_drawn_outside_a_terminal(capsys):
    with terminal.progress_bar() as report:
        report(0.5, "Through a lens")
    assert capsys.readouterr().err == ""


def test_lines_contain_no_control_characters(capsys):
    terminal.say("a\x1b[31mb", "c\nd", Path("e\udcfff\x07"), "")
    assert capsys.readouterr().out == "a?[31mb\nc d\ne?f?\n\n"


def test_labels_on_the_progress_bar_contain_no_control_characters(monkeypatch):
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    with terminal.progress_bar() as report:
        report(0.5, "Pass\x1b[2J")
    assert "Pass?[2J" in screen.getvalue()


@pytest.mark.parametrize("path", sorted((ROOT / "commands").glob("*.py")), ids=lambda path: path.name)
def test_commands_print_by_say(path):
    """Except constants, texts that they make for files, and JSON, which escapes control characters."""
    source = path.read_text(encoding="utf-8")
    if path.name not in ("terminal.py", "messages.py", "farm_log.py", "parser.py"):
        assert not re.findall(r"\bprint\((?!json\.dumps|macro, end|\"untrusted: this system)", source)
