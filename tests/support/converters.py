"""Raw converters of others, which develop a file as linear Rec. 709 under its own white balance."""

import os
import shutil
import subprocess

import numpy as np
from PIL import Image

NEUTRAL = """[Color Management]
InputProfile=(camera)
OutputProfile=RTv4_sRGB
[White Balance]
Setting=Camera
"""


def darktable(folder, name="a.dng"):
    """A file in a folder, developed without any look: array (row, column, 3)."""
    _run(["darktable-cli", name, "a.pfm", "--icc-type", "LIN_REC709", "--core", "--configdir", folder,
          "--disable-opencl", "--conf", "plugins/darkroom/workflow=none",
          "--conf", "plugins/darkroom/chromatic-adaptation=legacy"], folder)
    head, size, scale, light = (folder / "a.pfm").read_bytes().split(b"\n", 3)
    assert head == b"PF"
    columns, rows = map(int, size.split())
    return np.frombuffer(light, "<f4" if float(scale) < 0 else ">f4").reshape(rows, columns, 3)[::-1]


def rawtherapee(folder, name="a.dng"):
    """A file in a folder, developed without any look: array (row, column, 3)."""
    (folder / "neutral.pp3").write_text(NEUTRAL)
    _run(["rawtherapee-cli", "-o", "a.png", "-p", "neutral.pp3", "-n", "-b8", "-Y", "-c", name], folder)
    with Image.open(folder / "a.png") as file:
        encoded = np.asarray(file.convert("RGB")) / 255
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055)**2.4)


CONVERTERS = {"darktable": darktable, "RawTherapee": rawtherapee}


def installed(converter):
    return shutil.which(f"{converter.lower()}-cli") is not None


def _run(command, folder):
    """Run a program with settings in the folder instead of the user's."""
    result = subprocess.run(command, cwd=folder, env=os.environ | {"HOME": str(folder)}, capture_output=True, text=True,
                            timeout=300)
    assert result.returncode == 0, result.stdout + result.stderr
