"""A picture that is larger than the memory that is free for it, put through a lens.

    systemd-run --scope -p MemoryMax=4G python benchmarks/large_picture.py

filters noise of 7680 x 4320 px at 31 wavelengths in the folder that it is started in, which takes 17 GB on the disk
meanwhile, and prints its seconds, the memory that its report predicts, and the most that the process has held beside
pages of files (Linux), which the system takes back when it likes.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from timing import machine

from lensfield.engine import SpectralImage
from lensfield.engine.image.spectral_exr import write_exr
from lensfield.engine.memory import available_bytes

COMMAND = [sys.executable, "-c", "from lensfield.cli import console; console()", "filter", "in.exr",
           "--lens", "edmund-54852", "--azimuths", "4", "--psf-energy", "0.9", "--output", "out.exr",
           "--report", "report.json"]
SENSOR_UM = 4000
LOOK_S = 0.1


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, nargs=3, default=(7680, 4320, 31), metavar=("W", "H", "WAVELENGTHS"))
    width, height, wavelengths = parser.parse_args().size
    print(f"{machine()}, {available_bytes() / 1e9:.2f} GB free")
    with tempfile.TemporaryDirectory(dir=".") as folder:
        plane = np.random.default_rng(0).random((1, height, width), np.float32)
        cube = np.broadcast_to(plane, (wavelengths, height, width))
        write_exr(SpectralImage(cube, np.linspace(420, 680, wavelengths), pitch_um=SENSOR_UM / width),
                  Path(folder, "in.exr"))
        begin = time.perf_counter()
        held = most_held_bytes(subprocess.Popen(COMMAND, cwd=folder))
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        told = json.loads(Path(folder, "report.json").read_text())["plan"]["peak_mb"]
    print(f"{width} x {height}, {wavelengths} wavelengths, {4e-9 * width * height * wavelengths:.2f} GB: "
          f"{time.perf_counter() - begin:.0f} s, {used.ru_utime + used.ru_stime:.0f} of the processor, "
          f"told {told:.0f} MB, held {held / 1e6:.0f} MB")


def most_held_bytes(process):
    """The most that a process has held of memory that is no file's, until its end; an error where it fails."""
    most = 0
    while process.poll() is None:
        lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
        most = max([most, *(1024 * int(line.split()[1]) for line in lines if line.startswith("RssAnon:"))])
        time.sleep(LOOK_S)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, process.args)
    return most


if __name__ == "__main__":
    main()
