"""Build the extension zips for users: the source tree, its compiled loops, and the wheels that Blender lacks.

    python packaging/build_extension.py FOLDER [PLATFORM ...]

builds one zip for each platform, with the cross compilers listed in CONTRIBUTING.md. Each contains wheels for every
Python of Blender 4.5 and later, including the Pythons of Linux distributions, because Blender refuses an extension
without matching wheels. numpy is not included: Blender contains it.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import bpy

from lensfield.engine.kernels import build as kernels
from lensfield.engine.runtime import build_identity

ROOT = Path(__file__).resolve().parent.parent
KERNELS = "engine/kernels/lib"
REQUIREMENTS = ("scipy", "OpenEXR", "pillow", "PyYAML", "matplotlib",
                "contourpy", "cycler", "fonttools", "kiwisolver", "packaging", "pyparsing", "python-dateutil", "six")
"""The last line lists the dependencies of matplotlib, which draws lens sheets."""
PYTHONS = ("3.11", "3.13", "3.14")
PLATFORMS = {
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_14_0_arm64", "macosx_12_0_arm64", "macosx_11_0_arm64"),
}


def extension_tool():
    """Blender's extension builder, which does not require a running Blender."""
    scripts = Path(bpy.utils.resource_path("LOCAL")) / "scripts"
    return scripts / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"


def download_wheels(folder, platform):
    """Download wheels of every requirement for every Python of one platform."""
    for python in PYTHONS:
        tags = [word for tag in PLATFORMS[platform] for word in ("--platform", tag)]
        subprocess.run([sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:",
                        "--python-version", python, *tags, "--dest", folder, *REQUIREMENTS], check=True)


def stage(folder, platform):
    """Copy the tree with the loops of one platform, and add the platform and its wheels to the manifest."""
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "dist",
                                                                  "demo", Path(KERNELS).name))
    kernels.build(folder / KERNELS, platform)
    build_identity.store(ROOT, folder)
    download_wheels(folder / "wheels", platform)
    wheels = ",\n".join(f'  "./wheels/{path.name}"' for path in sorted((folder / "wheels").glob("*.whl")))
    manifest = folder / "blender_manifest.toml"
    text = re.sub(r"(?m)^\[permissions\]", f'platforms = ["{platform}"]\nwheels = [\n{wheels},\n]\n\n[permissions]',
                  manifest.read_text())
    manifest.write_text(text)


def build(output, platform):
    with tempfile.TemporaryDirectory() as temporary:
        source = Path(temporary) / "lensfield"
        stage(source, platform)
        subprocess.run([sys.executable, extension_tool(), "build", "--source-dir", source, "--output-dir", output,
                        "--split-platforms"], check=True)


def main(arguments):
    output = Path(arguments[0]).resolve()
    output.mkdir(parents=True, exist_ok=True)
    try:
        for platform in arguments[1:] or PLATFORMS:
            build(output, platform)
    except kernels.CompilerMissing as missing:
        sys.exit(f"lensfield: cannot build the zip without the C loops: {missing}")


if __name__ == "__main__":
    main(sys.argv[1:])
