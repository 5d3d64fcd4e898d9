"""Build steps that pyproject.toml cannot express: compile the C loops if a compiler is available, and tag the wheel.

Without a compiler, the package is pure Python, and numpy replaces the loops.
"""

import shutil
import subprocess
import sys
from pathlib import Path

from setuptools import Command, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build import build
from setuptools.command.build_py import build_py

KERNELS = Path("engine/kernels")
RUNTIME = Path("engine/runtime")
sys.path[:0] = [str(KERNELS.resolve()), str(RUNTIME.resolve())]

# build.py and build_identity.py in these folders require only Python
import build as kernels  # noqa: E402
import build_identity  # noqa: E402


class Step(Command):
    """A step of `build` without options."""

    user_options, editable_mode = [], False

    def initialize_options(self):
        self.build_lib = None

    def finalize_options(self):
        self.set_undefined_options("build", ("build_lib", "build_lib"))

    def get_source_files(self):
        return []

    def get_outputs(self):
        return []

    def get_output_mapping(self):
        return {}


class BuildKernels(Step):
    """Compile the library: into the tree for an editable installation, otherwise into the wheel.

    A wheel for a platform that `--plat-name` names, such as macos-arm64, is not built without it.
    """

    description = "compile engine/kernels"

    def get_source_files(self):
        return [str(path) for path in sorted(KERNELS.glob("*.[ch]"))]

    def run(self):
        package = Path() if self.editable_mode else Path(self.build_lib) / "lensfield"
        folder = (package / KERNELS / kernels.LIBRARY_FOLDER.name).resolve()
        if not self.editable_mode:
            shutil.rmtree(folder, ignore_errors=True)  # an earlier wheel's library would go unnoticed
        wheel = self.get_finalized_command("bdist_wheel")
        try:
            kernels.build(folder, wheel.plat_name if wheel.plat_name_supplied else None)
        except (kernels.CompilerMissing, subprocess.CalledProcessError) as problem:
            if wheel.plat_name_supplied:
                raise SystemExit(f"lensfield: no wheel for {wheel.plat_name}: {problem}") from None
            print(f"lensfield: {kernels.without(problem)}", file=sys.stderr)


class BuildPy(build_py):
    """Copy all modules but this one, which is in the folder of the package."""

    def find_package_modules(self, package, folder):
        return [found for found in super().find_package_modules(package, folder) if found[1] != Path(__file__).stem]


class BdistWheel(bdist_wheel):
    def get_tag(self):
        """py3-none-PLATFORM for a wheel with the library, which any Python 3 can load; otherwise py3-none-any."""
        if self.plat_name_supplied:
            return "py3", "none", kernels.WHEEL_TAGS[self.plat_name]
        self.root_is_pure = not list(Path(self.bdist_dir).rglob(kernels.library_name(kernels.this_platform())))
        *_, platform = super().get_tag()
        return "py3", "none", platform


class StoreIdentity(Step):
    """Store the build identity in the wheel, which does not contain all sources."""

    description = "store the build identity"

    def run(self):
        if not self.editable_mode:
            build_identity.store(Path(), Path(self.build_lib) / "lensfield")


build.sub_commands = [*build.sub_commands, ("build_kernels", None), ("store_identity", None)]
setup(cmdclass={"build_kernels": BuildKernels, "build_py": BuildPy, "store_identity": StoreIdentity,
                "bdist_wheel": BdistWheel})
