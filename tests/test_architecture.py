"""The border between the engine and Blender, read from the source itself."""

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import lensfield
import pytest

ROOT = Path(__file__).resolve().parents[1]
ENGINE = sorted((ROOT / "engine").rglob("*.py"))
COMMANDS = sorted((ROOT / "commands").glob("*.py"))
PACKAGE = sorted(ROOT.glob("*.py")) + ENGINE + COMMANDS + sorted((ROOT / "addon").rglob("*.py"))
ENGINE_MAY_IMPORT = sys.stdlib_module_names | {"numpy", "scipy", "OpenEXR", "PIL", "yaml", "matplotlib", "optiland",
                                            "finufft"}


def named(path):
    return str(path.relative_to(ROOT))


def imports(path):
    """(level, dotted name) of every import in a file, in functions too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((0, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((node.level, ".".join(filter(None, (node.module, alias.name)))) for alias in node.names)


def test_the_engine_is_found():
    assert {"engine/pipeline.py", "engine/lens_files/package.py"} <= {named(path) for path in ENGINE}


@pytest.mark.parametrize("path", ENGINE, ids=named)
def test_engine_imports_neither_blender_nor_anything_unexpected(path):
    absolute = {name.split(".")[0] for level, name in imports(path) if level == 0}
    assert absolute <= ENGINE_MAY_IMPORT


@pytest.mark.parametrize("path", ENGINE, ids=named)
def test_engine_relative_imports_stay_inside_the_engine(path):
    depth = len(path.relative_to(ROOT / "engine").parts)
    assert all(level <= depth for level, _ in imports(path))


@pytest.mark.parametrize("path", PACKAGE, ids=named)
def test_the_package_never_imports_itself_by_name(path):
    assert not [name for level, name in imports(path) if level == 0 and name.split(".")[0] in ("lensfield", "bl_ext")]


def test_importing_the_engine_loads_no_blender():
    code = "import sys, lensfield.engine; sys.exit('bpy' in sys.modules or 'lensfield.addon' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_package_and_extension_have_one_version():
    package = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extension = tomllib.loads((ROOT / "blender_manifest.toml").read_text())
    assert lensfield.__version__ == package["version"] == extension["version"]
