"""Build the wheels `lensfield`, one for each platform: all of its Python code, and the compiled loops.

    python packaging/build_wheels.py FOLDER [PLATFORM ...]

builds those of these platforms, such as linux-x64, or all, with the cross compilers listed in CONTRIBUTING.md, and
without a network: this Python has setuptools in pyproject.toml's version. The same compilers build the same bytes from
the same sources. Any Python 3 loads the loops, by ctypes, so that a platform needs
one wheel. Blender's extension contains the wheel, too, and takes the engine from it.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "engine" / "kernels"))

import build as kernels  # noqa: E402 - it requires only Python, and building a wheel must not require the package

EARLIEST_S = 315532800  # 1980, before which zips have no time: the time of all files in a wheel


def build(output, platform):
    """Build the wheel of a platform in a folder, and return its path.

    Raises
    ------
    subprocess.CalledProcessError
        A compiler is missing or failed, and pip has printed the reason.
    """
    with tempfile.TemporaryDirectory() as temporary:
        source, wheels = Path(temporary) / "lensfield", Path(temporary) / "wheels"
        shutil.copytree(ROOT, source, copy_function=shutil.copyfile, ignore=shutil.ignore_patterns(
            ".*", "__pycache__", "*.egg-info", "build", "dist", "demo", kernels.LIBRARY_FOLDER.name))
        subprocess.run([sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation",
                        "--no-cache-dir", "--wheel-dir", wheels,
                        f"--config-settings=--build-option=--plat-name={platform}", source], check=True,
                       env=os.environ | {"SOURCE_DATE_EPOCH": str(EARLIEST_S)}, umask=0o022)
        wheel, = wheels.glob("*.whl")
        return Path(shutil.move(wheel, output / wheel.name))


def main(arguments):
    output = Path(arguments[0]).resolve()
    output.mkdir(parents=True, exist_ok=True)
    platforms = arguments[1:] or list(kernels.WHEEL_TAGS)
    if unknown := [name for name in platforms if name not in kernels.WHEEL_TAGS]:
        sys.exit(f"lensfield: unknown platform {', '.join(unknown)}: expected {', '.join(kernels.WHEEL_TAGS)}")
    for platform in platforms:
        print(build(output, platform))


if __name__ == "__main__":
    main(sys.argv[1:])
