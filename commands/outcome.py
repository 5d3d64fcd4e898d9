"""What a command tells when it is done: its files, its seconds, and what to know of the picture; or why it is not."""

from ..engine import InputError

FAILURES = InputError, OSError, MemoryError
"""Told in one line; any other exception is a fault of the program."""


def finish(options, report, files):
    """Write the report, and say where the files are, how long each stage took, and the report's remarks."""
    if options.report:
        report.write(options.report)
    for path in files:
        print(path)
    for stage, seconds in report.stages.items():
        print(f"  {stage:<40}{seconds:8.2f} s")
    for remark in report.remarks():
        print(f"  {remark}")
