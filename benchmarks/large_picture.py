"""Filter a picture that is larger than the free memory.

    systemd-run --scope -p MemoryMax=4G python benchmarks/large_picture.py

filters noise of 7680 x 4320 px at 31 wavelengths in the current folder, which takes 17 GB of disk space temporarily. It
prints the seconds, the memory that the report predicts, and the process's peak memory (Linux) without pages of files,
which the system reclaims when necessary.
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
from lensfield.engine.pictures.spectral_exr import write_exr
from lensfield.engine.runtime.memory import available_bytes

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
        peak_bytes = peak_anonymous_bytes(subprocess.Popen(COMMAND, cwd=folder))
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        predicted_mb = json.loads(Path(folder, "report.json").read_text())["plan"]["peak_mb"]
    print(f"{width} x {height}, {wavelengths} wavelengths, {4e-9 * width * height * wavelengths:.2f} GB: "
          f"{time.perf_counter() - begin:.0f} s, {used.ru_utime + used.ru_stime:.0f} processor s, "
          f"predicted {predicted_mb:.0f} MB, peak {peak_bytes / 1e6:.0f} MB")


def peak_anonymous_bytes(process):
    """Peak memory of a process without pages of files; raise an error if the process fails."""
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
