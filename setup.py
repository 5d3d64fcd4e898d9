"""What pyproject.toml cannot say: the loops in C are compiled where there is a compiler, and the wheel is tagged so.

Without one the package is pure Python, and numpy does the loops' work.
"""

import shutil
import subprocess
import sys
from pathlib import Path

from setuptools import Command, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build import build

KERNELS = Path("engine/kernels")
sys.path.insert(0, str(KERNELS.resolve()))

import build as kernels  # noqa: E402  the module build.py there, which needs nothing but Python


class BuildKernels(Command):
    """A step of `build`: the library, into the tree where the package is used from there, else into the wheel."""

    description, user_options, editable_mode = "compile engine/kernels", [], False

    def initialize_options(self):
        self.build_lib = None

    def finalize_options(self):
        self.set_undefined_options("build", ("build_lib", "build_lib"))

    def get_source_files(self):
        return [str(path) for path in sorted(KERNELS.glob("*.[ch]"))]

    def get_outputs(self):
        return []

    def get_output_mapping(self):
        return {}

    def run(self):
        package = Path() if self.editable_mode else Path(self.build_lib) / "lensfield"
        folder = (package / KERNELS / kernels.LIBRARY_FOLDER.name).resolve()
        if not self.editable_mode:
            shutil.rmtree(folder, ignore_errors=True)  # that of an earlier wheel, of which nobody could tell
        try:
            kernels.build(folder)
        except (kernels.CompilerMissing, subprocess.CalledProcessError) as problem:
            print(f"lensfield: {kernels.without(problem)}", file=sys.stderr)


class BdistWheel(bdist_wheel):
    def get_tag(self):
        """py3-none-PLATFORM where the library is in the wheel, which any Python 3 can load; else that of any system."""
        self.root_is_pure = not list(Path(self.bdist_dir).rglob(kernels.library_name(kernels.this_platform())))
        *_, platform = super().get_tag()
        return "py3", "none", platform


build.sub_commands = [*build.sub_commands, ("build_kernels", None)]
setup(cmdclass={"build_kernels": BuildKernels, "bdist_wheel": BdistWheel})
