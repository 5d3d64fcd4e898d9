"""The processor time of each test, with its child processes: a report, not a verdict."""

import os
import sys
from pathlib import Path

import pytest

REPORT = Path(__file__).parents[2] / "build" / "test-times.txt"
LONGEST = 30  # tests to print
LEAST_S = 0.01  # of a test in the report


def processor_s():
    """Processor seconds of this process and of its children that have ended."""
    return sum(os.times()[:4])


class Times:
    """Adds the processor seconds of a run's tests to the report, and prints the longest."""

    def __init__(self):
        self._seconds = {}

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        begin_s = processor_s()
        result = yield
        self._seconds[item.nodeid] = processor_s() - begin_s
        return result

    def pytest_terminal_summary(self, terminalreporter, config):
        longest_first = sorted(self._seconds.items(), key=lambda each: -each[1])
        lines = [f"{seconds:9.2f} s  {name}" for name, seconds in longest_first if seconds >= LEAST_S]
        total = (f"{sum(self._seconds.values()):.0f} processor seconds for {len(self._seconds)} tests: "
                 f"{Path(sys.prefix).name}, {' '.join(map(str, config.invocation_params.args))}")
        REPORT.parent.mkdir(exist_ok=True)
        with open(REPORT, "a", encoding="utf-8") as report:
            report.write("\n".join([total, *lines, ""]))
        if len(self._seconds) > LONGEST:
            terminalreporter.write_line("\n".join([f"{total}; the longest:", *lines[:LONGEST]]))
