"""The result of a command: its files, seconds and remarks on the picture, or its error."""

from lensfield.engine import InputError

from .terminal import say

FAILURES = InputError, OSError, MemoryError
"""Reported in one line; any other exception is a bug."""


def finish(options, report, files):
    """Write the report, and print the files, the seconds of each stage, and the report's remarks."""
    if options.report:
        report.write(options.report)
    for path in files:
        say(path)
    for stage, seconds in report.stages.items():
        say(f"  {stage:<40}{seconds:8.2f} s")
    for remark in report.remarks():
        say(f"  {remark}")
