"""What Lensfield runs on, for reports of errors."""

import platform
import sys
from importlib.metadata import PackageNotFoundError, version

PACKAGES = "bpy", "numpy", "scipy", "OpenEXR", "wgpu"


def surroundings():
    """The versions of Python, the system, Blender, and installed packages, in one line. Nothing is imported for it."""
    blender = [f"Blender {sys.modules['bpy'].app.version_string}"] if "bpy" in sys.modules else []
    packages = [f"{name} {number}" for name in PACKAGES if (number := _version(name))]
    return ", ".join([f"Python {platform.python_version()}", platform.platform(), *blender, *packages])


def _version(package):
    """The version of an installed package; None for others, as for `bpy` within Blender."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None
