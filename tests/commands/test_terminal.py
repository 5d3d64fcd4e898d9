"""The progress bar on a terminal, and the remaining time that it estimates."""

import io
import sys
from types import SimpleNamespace

import pytest

from lensfield.commands import terminal


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
