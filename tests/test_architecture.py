"""The permitted imports between rooms, and the border between engine and Blender, checked in the source code."""

import ast
import re
import subprocess
import sys
import tomllib
from functools import cache

import pytest

import lensfield.engine
from places import ROOT

ENGINE_LIBRARIES = {"numpy", "scipy", "OpenEXR", "PIL", "yaml", "rawpy", "wgpu", "lensfunpy", "pycocotools"}

FLOORS = {
    # engine: foundations
    "engine.runtime": set(),
    "engine.kernels": {"engine.runtime"},
    "engine.spectral": {"engine.kernels", "engine.runtime"},
    # the lens: prescription and data
    "engine.prescription": {"engine.runtime", "engine.spectral"},
    "engine.lens": {"engine.prescription", "engine.runtime"},
    "engine.lens_files": {"engine.lens", "engine.runtime"},
    "engine.rays": {"engine.kernels", "engine.prescription", "engine.runtime", "engine.spectral"},
    "engine.bake": {"engine.kernels", "engine.lens", "engine.prescription", "engine.rays", "engine.runtime"},
    # photographs of lenses
    "engine.fitting": {"engine.prescription", "engine.rays", "engine.runtime"},
    # lens + radiance -> irradiance
    "engine.image": {"engine.runtime"},
    "engine.field": {"engine.image", "engine.kernels", "engine.lens", "engine.rays", "engine.runtime"},
    "engine.calibration": {"engine.field", "engine.image", "engine.lens", "engine.runtime"},
    "engine.blur": {"engine.field", "engine.kernels", "engine.runtime"},
    "engine.plan": {"engine.blur", "engine.field", "engine.image", "engine.kernels", "engine.lens", "engine.runtime"},
    "engine.depth": {"engine.field", "engine.image", "engine.kernels", "engine.lens", "engine.rays", "engine.runtime"},
    "engine.look": {"engine.depth", "engine.field", "engine.image", "engine.lens", "engine.rays"},
    "engine.stray": {"engine.depth", "engine.field", "engine.image", "engine.kernels", "engine.lens",
                     "engine.prescription", "engine.rays", "engine.runtime"},
    "engine.sensor": {"engine.image", "engine.kernels", "engine.runtime", "engine.spectral"},
    "engine.pictures": {"engine.field", "engine.image", "engine.lens", "engine.runtime", "engine.sensor",
                        "engine.spectral"},
    "engine.truth": {"engine.field", "engine.image", "engine.lens", "engine.runtime"},
    "engine.library": {"engine.bake", "engine.field", "engine.lens", "engine.lens_files",
                       "engine.prescription", "engine.rays", "engine.runtime", "engine.sensor"},
    "engine.measured": {"engine.calibration", "engine.field", "engine.lens", "engine.library", "engine.pictures",
                        "engine.rays", "engine.runtime"},
    "engine.simulation": {"engine.blur", "engine.depth", "engine.field", "engine.image", "engine.kernels",
                          "engine.lens", "engine.library", "engine.pictures", "engine.plan", "engine.runtime",
                          "engine.sensor", "engine.spectral", "engine.stray"},
    # irradiance -> photograph
    "engine.photo": {"engine.field", "engine.image", "engine.lens", "engine.pictures", "engine.runtime",
                     "engine.sensor", "engine.simulation"},
    "engine.inspection": {"engine.field", "engine.image", "engine.lens", "engine.pictures", "engine.plan",
                          "engine.prescription", "engine.rays", "engine.runtime", "engine.simulation",
                          "engine.spectral", "engine.stray"},
    "engine": {"engine.image", "engine.lens", "engine.library", "engine.plan", "engine.prescription", "engine.rays",
               "engine.runtime", "engine.simulation", "engine.stray"},
    # for scripts of BlenderProc
    "blenderproc": {"engine"},
    # the request for a render
    "request": {"engine"},
    # Blender's side
    "addon.scene": {"engine"},
    "addon.shading": {"addon.scene", "engine"},
    "addon.job": {"addon.shading", "addon.scene", "request", "engine"},
    "addon.capture": {"addon.job", "addon.shading", "addon.scene", "request", "engine"},
    "addon.render": {"addon.capture", "addon.job", "addon.shading", "addon.scene", "request", "engine"},
    "addon.ui.common": {"addon.render", "addon.job", "addon.shading", "addon.scene", "request", "engine"},
    "addon.ui.preview": {"addon.ui.common", "addon.render", "addon.capture", "addon.job", "addon.shading",
                         "addon.scene", "request", "engine"},
    "addon.ui.live": {"addon.ui.common", "addon.job", "addon.scene", "request", "engine"},
    "addon.ui": {"addon.ui.live", "addon.ui.preview", "addon.ui.common", "addon.render", "addon.capture", "addon.job",
                 "addon.shading", "addon.scene", "request", "engine"},
    "addon": {"addon.ui", "addon.ui.live", "addon.ui.preview", "addon.ui.common", "addon.render", "addon.job",
              "addon.scene", "request", "engine"},
    # the command, and the entry points of Blender and Python
    "commands": {"addon", "addon.shading", "request", "engine"},
    "cli": {"commands", "engine", ""},
    "restart": set(),
    "": {"cli", "addon", "restart"},
}
"""The rooms that each room may import from, in addition to itself. "engine" means all of its rooms."""

def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for top in ("engine", "addon", "commands")
           for path in sorted((ROOT / top).rglob("*.py"))} | {
               "cli": ROOT / "cli.py", "request": ROOT / "request.py", "restart": ROOT / "restart.py",
               "blenderproc": ROOT / "blenderproc.py",
               "": ROOT / "__init__.py"}


@cache
def imports(name):
    """List of (module or library, whether the module belongs to the package) of all imports, also in functions.

    Imports for the type checker alone do not count.
    """
    path = MODULES[name]
    package = package_of(name)
    tree = ast.parse(path.read_text(encoding="utf-8"))
    unused = {inner for node in ast.walk(tree) if isinstance(node, ast.If)
              and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING" for inner in ast.walk(node)}
    found = []
    for node in set(ast.walk(tree)) - unused:
        if isinstance(node, ast.Import):
            found += [(alias.name, False) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level and not node.module.startswith("lensfield."):
            found.append((node.module, False))
        elif isinstance(node, ast.ImportFrom):
            base = source(node, package)
            for alias in node.names:
                inner = f"{base}.{alias.name}".strip(".")
                found.append((inner if inner in MODULES else base, True))
    return found


def package_of(name):
    """The parts of the name of a module's package."""
    return name.split(".") if MODULES[name].name == "__init__.py" else name.split(".")[:-1]


def source(node, package):
    """The module or package of this package that an import names, without `lensfield`."""
    folder = [part for part in package if part][:len(package) + 1 - node.level] if node.level else []
    return ".".join(filter(None, [*folder, (node.module or "").removeprefix("lensfield.")]))


def room(name):
    """The room of a module: the longest name in the table that the module's name starts with."""
    parts = name.split(".")
    return next(prefix for count in range(len(parts), -1, -1)
                if (prefix := ".".join(parts[:count])) in FLOORS)


def allowed(name, other):
    floor, used = room(name), room(other)
    return floor == used or used in FLOORS[floor] or ("engine" in FLOORS[floor] and other.startswith("engine"))


def test_every_import_goes_to_a_lower_floor_of_the_table():
    upwards = [f"{name or 'lensfield'} imports {other or 'lensfield'}" for name in MODULES
               for other, relative in imports(name)
               if relative and not allowed(name, other)]
    assert not upwards


def test_the_table_has_no_cycles_and_no_missing_rooms():
    order = list(FLOORS)
    for floor, used in FLOORS.items():
        assert all(other in FLOORS for other in used) and any(room(name) == floor for name in MODULES)
    placed, left = set(), {floor: {other for other in used if other != floor} for floor, used in FLOORS.items()}
    left["cli"].discard("")  # the version number
    while left:
        ready = [floor for floor in order if floor in left and left[floor] <= placed]
        assert ready, f"a circle among {sorted(left)}"
        placed.update(ready)
        left = {floor: used for floor, used in left.items() if floor not in ready}


def test_every_folder_is_a_room_or_inside_one():
    folders = {".".join(path.parent.relative_to(ROOT).parts[:2]) for path in MODULES.values()}
    assert folders <= set(FLOORS)


def test_the_engine_imports_neither_blender_nor_undeclared_libraries():
    known = sys.stdlib_module_names | ENGINE_LIBRARIES
    unknown = [f"{name} imports {other}" for name in MODULES if name.startswith("engine")
               for other, relative in imports(name) if not relative and other.split(".")[0] not in known]
    assert not unknown


def test_the_engine_and_nothing_else_is_imported_by_name():
    """In Blender, the engine comes from a wheel, and everything else from the extension, whose package has another
    name. The engine's own imports are relative."""
    wrong = []
    for name, path in MODULES.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.level or node.module.startswith(("lensfield", "bl_ext"))):
                enters_engine = not name.startswith("engine") and source(node, package_of(name)).startswith("engine")
                if enters_engine == bool(node.level):
                    wrong.append(f"{name or 'lensfield'} imports {node.module}")
    assert not wrong


def test_every_folder_of_code_is_installed():
    folders = {".".join(["lensfield", *path.parent.relative_to(ROOT).parts]) for path in MODULES.values()}
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    assert folders == set(declared)


@pytest.mark.parametrize("module", ["lensfield.engine", "lensfield.cli"])
def test_engine_and_command_do_not_load_blender(module):
    code = f"import sys, {module}; sys.exit('bpy' in sys.modules or 'lensfield.addon' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_parts_of_scipy_are_imported_when_they_are_used():
    """`import scipy` imports a part at its first use. Importing all that the engine uses takes half a second."""
    early = [f"{name} imports {other}" for name in MODULES for other, relative in imports(name)
             if not relative and other.startswith("scipy.") and name != "engine.lens_files.iset_mat_child"]
    assert not early


@pytest.mark.parametrize("code, absent", [
    ("import lensfield", {"lensfield.engine"}),
    ("from lensfield import *", {"scipy.fft", "scipy.interpolate", "scipy.optimize", "rawpy", "wgpu"}),
    ("import lensfield.engine; lensfield.engine.LensError", {"numpy"}),
    ("import lensfield.cli; lensfield.cli.main(['--version'])", {"numpy", "scipy"}),
    ("import lensfield.cli; lensfield.cli.main(['lint', '--help'])", {"scipy.fft", "lensfield.commands.filter"})])
def test_a_program_loads_only_what_it_needs(code, absent):
    loaded = subprocess.run([sys.executable, "-c", f"{code}\nimport sys; print(); print(*sys.modules)"], check=True,
                            capture_output=True, text=True).stdout.splitlines()[-1].split()
    assert not absent & set(loaded)


def test_every_public_name_of_the_engine_has_its_module():
    assert set(lensfield.engine._MODULES) == set(lensfield.engine.__all__)
    assert all(getattr(lensfield, name).__name__ == name for name in lensfield.__all__)
    assert lensfield.__all__ == lensfield.engine.__all__ and "simulate" in dir(lensfield)


def test_package_and_extension_have_the_same_version():
    """`__version__` is the source: the package reads it, and the manifest, which cannot read it, repeats it."""
    package = tomllib.loads((ROOT / "pyproject.toml").read_text())
    extension = tomllib.loads((ROOT / "blender_manifest.toml").read_text())
    assert package["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "lensfield.__version__"}
    assert "version" not in package["project"] and extension["version"] == lensfield.__version__


def test_the_newest_release_of_the_changelog_is_this_version():
    heading = r"(?m)^## (\d\S*) \((?:\d{4}-\d\d-\d\d|not yet released)\)$"
    releases = re.findall(heading, (ROOT / "CHANGELOG.md").read_text())
    assert releases[0] == lensfield.__version__


def public_functions(tree):
    """(name, its node, its arguments except `self`) of each public function, method and constructor."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node.name, node, taken(node)
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for inner in node.body:
                if isinstance(inner, ast.FunctionDef) and (
                        inner.name in ("__init__", "__call__") or not inner.name.startswith("_")):
                    static = any(ast.unparse(each) == "staticmethod" for each in inner.decorator_list)
                    yield f"{node.name}.{inner.name}", inner, taken(inner)[0 if static else 1:]


def taken(function):
    """The arguments of a function."""
    given = function.args
    return [*given.posonlyargs, *given.args, *given.kwonlyargs, *filter(None, (given.vararg, given.kwarg))]


def test_public_functions_of_the_engine_have_type_annotations():
    """`make lint` needs the types of all arguments and results."""
    silent = [f"{module}.{name}" for module, path in MODULES.items()
              if module.startswith("engine")
              for name, function, given in public_functions(ast.parse(path.read_text(encoding="utf-8")))
              if any(each.annotation is None for each in given)
              or (function.returns is None and function.name != "__init__")]
    assert not silent
