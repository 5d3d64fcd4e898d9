"""What the commands say where Blender's wheel, or what it needs, is missing."""

import re
import sys

import pytest

from lensfield.cli import main
from lensfield.commands.blend import LIBRARIES, PYTHONS
from places import ROOT, SAMPLE_SCENE


class Unloadable:
    """Finds `bpy`, whose import fails for want of a system library."""

    def find_spec(self, name, path=None, target=None):
        if name == "bpy":
            raise ImportError("libX11.so.6: cannot open shared object file", name="bpy")


def refusal(capsys):
    assert main(["render", str(SAMPLE_SCENE)]) == 1
    line, = capsys.readouterr().err.splitlines()
    return line


@pytest.mark.parametrize("version, remedy", [
    ((3, 11, 2), 'pip install "lensfield[blender]"'),
    ((3, 12, 1), "Blender's wheel is for Python 3.11 and 3.13, and this is 3.12: use one of those, or Blender itself")])
def test_without_blenders_wheel_the_remedy_depends_on_the_version_of_python(version, remedy, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "bpy", None)
    monkeypatch.setattr(sys, "version_info", version)
    assert refusal(capsys) == f"lensfield: bpy: module is not installed: {remedy}"


def test_a_missing_system_library_is_named_with_the_packages_to_install(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "bpy", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Unloadable(), *sys.meta_path])
    line = refusal(capsys)
    assert line.startswith("lensfield: bpy: system library is libX11.so.6: cannot open shared object file: ")
    assert line.endswith(f"; on Debian or Ubuntu: sudo apt-get install {LIBRARIES}")


def test_the_named_packages_are_those_that_the_environments_install():
    script = (ROOT / "packaging" / "environment.sh").read_text()
    assert re.search(r'^libraries="(.*)"$', script, re.MULTILINE)[1] == LIBRARIES


def test_the_versions_of_python_are_those_for_which_the_extra_installs_blender():
    extra = re.search(r"^blender = (.*)$", (ROOT / "pyproject.toml").read_text(), re.MULTILINE)[1]
    assert re.findall(r"python_version == '(\d+)\.(\d+)'", extra) == [tuple(map(str, each)) for each in PYTHONS]
