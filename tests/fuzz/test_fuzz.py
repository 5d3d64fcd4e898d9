"""A small version of `make fuzz`: a dozen mutants of each kind of file. SEED=1 selects others."""

import subprocess
import sys

import pytest

from places import ROOT
from seed import SEED

pytestmark = pytest.mark.ci_only
PROGRAM = ROOT / "tests/fuzz/fuzz.py"


def said(*options):
    run = subprocess.run([sys.executable, PROGRAM, "--seed", str(SEED), *options], capture_output=True, text=True)
    return run.returncode, run.stdout + run.stderr


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems neither fork nor limit so")
def test_damaged_files_are_read_or_rejected():
    status, text = said("--count", "12")
    assert status == 0, text
    kinds = [line for line in text.splitlines() if " read " in line]
    assert len(kinds) >= 20 and all(" 0 findings " in line for line in kinds), text


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems neither fork nor limit so")
def test_small_hostile_files_stay_cheap():
    run = subprocess.run([sys.executable, ROOT / "tests/fuzz/bombs.py"], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr


FAULTS = {"an error of Python's": ("raise KeyError('x')", "KeyError"),
          "a warning": ("np.float32(1e38) * np.float32(1e38)", "RuntimeWarning"),
          "a signal": ("os.kill(os.getpid(), signal.SIGSEGV)", "signal: SIGSEGV"),
          "a loop": ("[None for _ in iter(int, 1) if 0]", "hang: over"), "memory": ("bytes(2**30)", "MemoryError"),
          "a word": ("print('\\x1b[31m')", "chatter"), "a message that steers": ("raise Steering(*'abcd')", "message")}


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems neither fork nor limit so")
@pytest.mark.parametrize("statement, outcome", FAULTS.values(), ids=FAULTS)
def test_each_fault_is_reported_as_a_finding(statement, outcome):
    """For all damaged files, this statement replaces the reader of wavelengths.

    The seed is fixed: with some seeds, damage turns one sound file into the other.
    """
    code = f"""if True:
        import os, signal, sys
        sys.argv[:] = ["fuzz.py", "--count", "3", "--only", "wavelengths", "--seed", "0"]
        sys.path.insert(0, {str(PROGRAM.parent)!r})
        import fuzz, numpy as np
        from lensfield.engine import InputError
        Steering = type("Steering", (InputError,), {{"__str__": lambda self: "\\x1b[31m"}})
        sound = [b"400:700:31", b"450, 550, 650.5"]

        def read(path):
            if path.read_bytes() not in sound:
                {statement}

        def formats(folder):
            from dataclasses import replace
            yield from ((name, replace(kind, read=read)) for name, kind in every(folder) if name == "wavelengths")

        every, fuzz.formats, fuzz.MORE_UNITS = fuzz.formats, formats, 100
        fuzz.main()"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 1 and outcome in run.stdout and "3 findings" in run.stdout, run.stdout + run.stderr
