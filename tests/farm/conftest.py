"""A small scene of two frames, rendered locally as the reference for disturbed and undisturbed renders on farms."""

import os
import subprocess
import sys

import pytest

from places import ROOT
from small_farm import LENSFIELD, OPTIONS

SAVE = """
import os, sys
from kill import save_scene
from lensfield import addon
addon.register()
save_scene(sys.argv[1], 1)
os._exit(0)
"""


@pytest.fixture(scope="session")
def blend(tmp_path_factory):
    """A .blend whose path contains special characters."""
    path = tmp_path_factory.mktemp("größe 'q\" $x") / "ein ende.blend"
    subprocess.run([sys.executable, "-c", SAVE, path], check=True, capture_output=True,
                   env=os.environ | {"PYTHONPATH": os.pathsep.join(
                       [str(ROOT / "tests" / "reliability"), *filter(None, [os.environ.get("PYTHONPATH")])])})
    return path


@pytest.fixture(scope="session")
def serial(blend, tmp_path_factory):
    """The folder of the reference render, made on this machine alone. As for the farm's renders, the .blend is at
    ../.. from there: radiance states this."""
    folder = tmp_path_factory.mktemp("serial") / "out"
    subprocess.run([*LENSFIELD, "render", blend, *OPTIONS, "--output", folder], check=True, capture_output=True)
    return folder
