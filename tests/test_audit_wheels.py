"""The audit of wheels finds libraries that would not load everywhere."""

import subprocess
import zipfile

import pytest

from lensfield.engine.kernels import build
from lensfield.engine.kernels.declarations import FUNCTIONS
from scripts import script

DEFINITIONS = "".join(f"int {name}(void) {{ return 0; }}\n" for name in FUNCTIONS)


@pytest.fixture(scope="module")
def audit():
    return script("packaging/audit_wheels.py")


@pytest.fixture
def wheel_of(tmp_path):
    """A wheel of this platform, or of another, with the library that C code makes here: a function of (code, flags,
    platform)."""
    here = build.this_platform()

    def make(code, *flags, target=here):
        library = tmp_path / build.library_name(target)
        try:
            subprocess.run([*build.compiler(here), "-shared", "-fPIC", "-xc", "-", *flags, "-o", library], check=True,
                           input=code, text=True)
        except build.CompilerMissing as missing:
            pytest.skip(str(missing))
        wheel = tmp_path / f"lensfield-1.0-py3-none-{build.WHEEL_TAGS[target]}.whl"
        with zipfile.ZipFile(wheel, "w") as contents:
            contents.write(library, f"lensfield/engine/kernels/lib/{library.name}")
        return wheel

    return make


def test_a_library_with_all_functions_that_needs_nothing_passes(audit, wheel_of):
    assert audit.findings(wheel_of(DEFINITIONS, "-nostdlib")) == []


def test_libraries_functions_and_machines_are_checked(audit, wheel_of):
    needs, = audit.findings(wheel_of(DEFINITIONS, "-nostartfiles", "-Wl,--no-as-needed", "-lm"))
    assert needs.startswith("it needs lib")
    caller = DEFINITIONS + "int puts(const char *); int call(void) { return puts(\"\"); }"
    assert audit.findings(wheel_of(caller, "-nostdlib")) == ["it imports puts"]
    lacking = DEFINITIONS.replace("lf_abi", "lf_other")
    assert audit.findings(wheel_of(lacking, "-nostdlib")) == ["it lacks lf_abi"]
    other = "linux-arm64" if build.this_platform() == "linux-x64" else "linux-x64"
    machine, = audit.findings(wheel_of(DEFINITIONS, "-nostdlib", target=other))
    assert machine.startswith("it is for ")


def test_a_wheel_contains_the_library_that_its_name_promises(audit, tmp_path):
    wheel = tmp_path / "lensfield-1.0-py3-none-win_amd64.whl"
    zipfile.ZipFile(wheel, "w").close()
    assert audit.findings(wheel) == ["expected one library, kernels-windows-x64.dll, found none"]
    assert audit.findings(tmp_path / "lensfield-1.0-py3-none-any.whl") == ["no platform has the tag any"]
