"""Measure the processor seconds that programs take to start, in separate processes: the least of several.

    python benchmarks/start_figures.py
"""

import os
import resource
import subprocess
import sys

TIMES = 5
PROGRAMS = {
    "Python": "pass",
    "numpy": "import numpy",
    "lensfield --version": "import lensfield.cli; lensfield.cli.main(['--version'])",
    "lensfield render --help": "import lensfield.cli; lensfield.cli.main(['render', '--help'])",
    "import lensfield.engine": "import lensfield.engine",
    "all names of the engine": "from lensfield.engine import *",
    "bpy": "import bpy",
    "bpy, with the extension registered": "import bpy, lensfield; lensfield.register()",
}


def processor_s(code):
    """Processor seconds of a Python process that runs some code."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code + "\nimport os, sys; sys.stdout.flush(); os._exit(0)"], check=True,
                   stdout=subprocess.DEVNULL, env={name: value for name, value in os.environ.items()
                                                   if name != "PYTHONDONTWRITEBYTECODE"})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main():
    for name, code in PROGRAMS.items():
        print(f"{name:<36}{min(processor_s(code) for _ in range(TIMES)):6.2f} s", flush=True)


if __name__ == "__main__":
    main()
