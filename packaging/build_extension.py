"""Build the extension zips for users: the add-on in Python, the wheel with the engine, and those that Blender lacks.

    python packaging/build_extension.py FOLDER [ZIP ...]

builds these zips, such as linux-x64-blender5.1, or all of them: one for each platform and generation of Blender. FOLDER
contains the wheels of packaging/build_wheels.py for their platforms. It becomes a repository of extensions: on any web
server, Blender installs and updates from its index.json, and chooses the zip for its platform, version and Python. A
generation has one version of Python, and Blender refuses an extension without wheels for its Python. numpy is not
included: Blender contains it.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import bpy

from lensfield import __version__
from lensfield.engine.kernels.build import WHEEL_TAGS

ROOT = Path(__file__).resolve().parent.parent
COMPILED = "scipy", "OpenEXR", "pillow", "PyYAML", "rawpy", "wgpu==0.32.*", "cffi"
PURE = "rendercanvas", "pycparser"
"""Requirements in Python alone: dependencies of wgpu."""
PLATFORMS = {
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_27_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_14_0_arm64", "macosx_12_0_arm64", "macosx_11_0_arm64"),
}
LARGEST_MB = 60  # of which scipy takes 35


@dataclass(frozen=True)
class Generation:
    """Versions of Blender with the same Python; from the first one up to, but not including, the end.

    Attributes
    ----------
    suffix : str
        Of the extension's version. extensions.blender.org takes one zip of a version for each platform, so generations
        need different versions. As that of a pre-release, it comes before the version for newer Blenders.
    """

    python: str
    first: str
    end: str | None = None
    suffix: str = ""
    platforms: tuple[str, ...] = tuple(PLATFORMS)


GENERATIONS = {
    "blender4.5": Generation("3.11", "4.5.0", "5.1.0", "-blender4.5"),
    "blender5.1": Generation("3.13", "5.1.0"),
    # Blender as built by Linux distributions
    "python3.14": Generation("3.14", "4.5.0", platforms=("linux-x64",)),
}
ZIPS = {f"{platform}-{name}": (platform, generation) for name, generation in GENERATIONS.items()
        for platform in generation.platforms}


def use_extension_tool(*words):
    """Run Blender's tool for extensions, which does not require a running Blender."""
    scripts = Path(bpy.utils.resource_path("LOCAL")) / "scripts"
    subprocess.run([sys.executable, scripts / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py", *words], check=True)


def download_wheels(folder, platform, python):
    """Download wheels of every requirement for a version of Python on a platform."""
    tags = [word for tag in PLATFORMS[platform] for word in ("--platform", tag)]
    anywhere = ["--implementation", "py", "--abi", "none", "--platform", "any"]
    for how, requirements in ((tags, COMPILED), (anywhere, PURE)):
        subprocess.run([sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:",
                        "--python-version", python, *how, "--dest", folder, *requirements], check=True)


def stage(folder, wheel, platform, generation):
    """Copy the tree, and add the platform, its wheels and the versions of Blender to the manifest."""
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(".*", "__pycache__", "build", "dist", "demo"))
    download_wheels(folder / "wheels", platform, generation.python)
    shutil.copy(wheel, folder / "wheels")
    wheels = ",\n".join(f'  "./wheels/{path.name}"' for path in sorted((folder / "wheels").glob("*.whl")))
    manifest = folder / "blender_manifest.toml"
    versions = f'blender_version_min = "{generation.first}"\n'
    if generation.end:
        versions += f'blender_version_max = "{generation.end}"\n'
    text = manifest.read_text(encoding="utf-8")
    text = re.sub(r"(?m)^version = .*\n", f'version = "{__version__}{generation.suffix}"\n', text)
    text = re.sub(r"(?m)^blender_version_min = .*\n", versions, text)
    text = re.sub(r"(?m)^\[permissions\]", f'platforms = ["{platform}"]\nwheels = [\n{wheels},\n]\n\n[permissions]',
                  text)
    manifest.write_text(text, encoding="utf-8")


def build(output, name):
    """Build a zip, let Blender's own tool validate it, and return its path.

    Raises
    ------
    FileNotFoundError
        The folder lacks the wheel of the zip's platform.
    """
    platform, generation = ZIPS[name]
    wheel = output / f"lensfield-{__version__}-py3-none-{WHEEL_TAGS[platform]}.whl"
    path = output / f"lensfield-{__version__}-{name}.zip"
    with tempfile.TemporaryDirectory() as temporary:
        source = Path(temporary) / "lensfield"
        stage(source, wheel, platform, generation)
        use_extension_tool("build", "--source-dir", source, "--output-filepath", path)
        use_extension_tool("validate", path)
    return path


def main(arguments):
    output = Path(arguments[0]).resolve()
    output.mkdir(parents=True, exist_ok=True)
    names = arguments[1:] or list(ZIPS)
    if unknown := [name for name in names if name not in ZIPS]:
        sys.exit(f"lensfield: unknown zip {', '.join(unknown)}: expected {', '.join(ZIPS)}")
    try:
        paths = [build(output, name) for name in names]
    except FileNotFoundError as missing:
        sys.exit(f"lensfield: {missing.filename}: missing: build it with packaging/build_wheels.py")
    use_extension_tool("server-generate", "--repo-dir", output, "--html")
    if large := [path.name for path in paths if path.stat().st_size > 1e6 * LARGEST_MB]:
        sys.exit(f"lensfield: larger than {LARGEST_MB} MB: {', '.join(large)}")


if __name__ == "__main__":
    main(sys.argv[1:])
