"""Compare the peak memory of complete commands with their plans.

    python benchmarks/memory_figures.py

filters and renders some pictures, each in a separate process, and prints a line for each: the prediction of the report,
the peak that the system (Linux) measured, and their ratio.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from timing import machine

from lensfield.engine import SpectralImage
from lensfield.engine.pictures.spectral_exr import write_exr, write_rgb_exr

COMMAND = [sys.executable, "-c", """
import os, sys
from lensfield.cli import main
status = main(sys.argv[1:])
with open("/proc/self/status") as status_file, open("peak", "w") as peak:
    peak.write(next(line.split()[1] for line in status_file if line.startswith("VmHWM:")))
sys.stdout.flush()
os._exit(status)"""]
"""The command, which also writes its peak memory in kB: the figure that a parent process gets includes the parent's."""
SCENE = Path(__file__).resolve().parents[1] / "sample_scenes" / "evening_chess.blend"
LENS = ["--lens", "edmund-54852"]
RENDER = ["render", str(SCENE), *LENS, "--samples", "1", "--tier", "preview"]
MEGABYTE, MOST = 1e6, 1.3


def spectral(wavelengths, width, height):
    """A picture of noise, on a sensor 4 mm wide."""
    plane = np.random.default_rng(0).random((1, height, width), np.float32)
    cube = np.broadcast_to(plane, (wavelengths, height, width))
    return SpectralImage(cube, np.linspace(420, 680, wavelengths), pitch_um=4000 / width)


CASES = {
    "filter 960 x 540, 31 wavelengths": (spectral(31, 960, 540), []),
    "filter 1920 x 1080, 7": (spectral(7, 1920, 1080), []),
    "filter 1920 x 1080, 7, and a preview": (spectral(7, 1920, 1080), ["--preview", "o.png"]),
    "filter 1920 x 1080, 31": (spectral(31, 1920, 1080), []),
    "filter 3840 x 2160, 3, and a preview": (spectral(3, 3840, 2160), ["--preview", "o.png"]),
    "filter 1920 x 1080, 3, to 0.1 %": (spectral(3, 1920, 1080), ["--accuracy", "0.001"]),
    "filter 960 x 540, 3, each pixel 2 x 2": (spectral(3, 960, 540), ["--supersampling", "2"]),
    "filter 1920 x 1080 in RGB, 31": (None, ["--wavelengths", "420:680:31"]),
    "render 480 x 270, 3": ([], ["--wavelengths", "450:650:3", "--resolution", "480x270"]),
    "render 1280 x 720, 21, without depth": (
        [], ["--wavelengths", "450:650:21", "--resolution", "1280x720", "--depth", "off"]),
    "render 1280 x 720, 21": ([], ["--wavelengths", "450:650:21", "--resolution", "1280x720"]),
    "render 1920 x 1080, 12, standard": (
        [], ["--wavelengths", "450:650:12", "--resolution", "1920x1080", "--tier", "standard"]),
}


def main():
    print(f"{machine()}\n\n{'case':<42}{'predicted':>9}{'used':>9}{'ratio':>11}")
    for name, (picture, more) in CASES.items():
        with tempfile.TemporaryDirectory() as folder:
            predicted, used = measured(picture, more, Path(folder))
        ratio = used / predicted
        missed = "" if 1 / MOST <= ratio <= MOST else " !"
        print(f"{name:<42}{predicted:>6.0f} MB{used:>6.0f} MB{ratio:>11.2f}{missed}", flush=True)


def measured(picture, more, folder):
    """The peak memory of a command in MB: predicted, and measured."""
    if picture == []:
        command = [*RENDER, *more, "--output", "out"]
    else:
        if picture is None:
            write_rgb_exr(np.random.default_rng(0).random((1080, 1920, 3), np.float32), folder / "in.exr")
        else:
            write_exr(picture, folder / "in.exr")
        command = ["filter", "in.exr", *LENS, *more, "--output", "o.exr"]
    subprocess.run([*COMMAND, *command, "--report", "report.json"], cwd=folder, check=True, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL)
    report = json.loads((folder / "report.json").read_text())
    predicted = max(report["plan"]["peak_mb"], report.get("capture_peak_mb", 0))
    return predicted, int((folder / "peak").read_text()) * 1024 / MEGABYTE


if __name__ == "__main__":
    main()
