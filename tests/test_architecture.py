"""The house: which room may use which, and the border between the engine and Blender, read from the source itself."""

import ast
import subprocess
import sys
import tomllib

import pytest

import lensfield
from places import ROOT

ENGINE_LIBRARIES = {"numpy", "scipy", "OpenEXR", "PIL", "yaml", "matplotlib"}

FOUNDATION = {"engine.cache", "engine.errors", "engine.files", "engine.kernels", "engine.locks", "engine.memory",
              "engine.scratch", "engine.threads", "engine.values"}
FLOORS = {
    # the engine's foundation, which all of it may use
    "engine.cache": {"engine.errors", "engine.files"},
    "engine.errors": set(),
    "engine.files": {"engine.errors"},
    "engine.kernels": {"engine.errors"},
    "engine.locks": {"engine.errors", "engine.files"},
    "engine.memory": {"engine.errors"},
    "engine.scratch": {"engine.errors", "engine.files", "engine.memory"},
    "engine.threads": set(),
    "engine.values": set(),
    # the engine, from the bottom: every room uses those below alone
    "engine.spectral": FOUNDATION,
    "engine.image": {"engine.spectral"} | FOUNDATION,
    "engine.field": {"engine.image"} | FOUNDATION,
    "engine.blur": {"engine.field", "engine.image"} | FOUNDATION,
    "engine.plan": {"engine.blur", "engine.field", "engine.image"} | FOUNDATION,
    "engine.report": {"engine.plan", "engine.image"} | FOUNDATION,
    "engine.depth": {"engine.field", "engine.image"} | FOUNDATION,
    "engine.simulate": {"engine.depth", "engine.library", "engine.report", "engine.plan", "engine.blur",
                        "engine.field", "engine.image", "engine.lens"} | FOUNDATION,
    "engine.trade": {"engine.simulate", "engine.report", "engine.plan", "engine.field", "engine.image",
                     "engine.spectral", "engine.lens", "engine.sheet"} | FOUNDATION,
    # beside: lens data, their sheet and how they are made
    "engine.lens": {"engine.field", "engine.spectral"} | FOUNDATION,
    "engine.sheet": {"engine.lens", "engine.spectral"} | FOUNDATION,
    "engine.bake": {"engine.lens", "engine.field", "engine.image", "engine.spectral"} | FOUNDATION,
    "engine.library": {"engine.bake", "engine.lens"} | FOUNDATION,
    "engine": {"engine.simulate", "engine.lens", "engine.plan", "engine.image", "engine.report"} | FOUNDATION,
    # what a command tells the window that started it
    "commands.messages": set(),
    "commands.child": {"commands.messages"},
    # Blender's side
    "addon.scene": {"engine"},
    "addon.shading": {"addon.scene", "engine"},
    "addon.job": {"addon.shading", "addon.scene", "commands.child", "engine"},
    "addon.ui": {"addon.job", "addon.shading", "addon.scene", "commands.child", "commands.messages", "engine"},
    "addon": {"addon.ui", "addon.job", "addon.scene", "engine"},
    # the command, and what Blender and Python call
    "commands": {"commands.child", "commands.messages", "addon", "addon.shading", "engine"},
    "cli": {"commands", "engine", ""},
    "": {"cli", "addon"},
}
"""Each room, and the rooms that it may import from, inside itself aside. "engine" stands for all of its rooms."""

DOORS = {("engine.lens.lens", "engine.library")}
"""(module, room): methods that call a room above when they are called, and are told of in docs/architecture.md."""

SIMULATE = {"engine.channel", "engine.kept"}
"""Modules of the engine's upper floor: they and `simulate` are one room."""


def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for top in ("engine", "addon", "commands")
           for path in sorted((ROOT / top).rglob("*.py"))} | {
               "cli": ROOT / "cli.py", "": ROOT / "__init__.py"}


def imports(name):
    """(the module, or the library, of every import in a module, in functions too; and whether it is relative).

    Names for the type checker alone are not used: a function may say that it takes a Lens, whoever made it.
    """
    path = MODULES[name]
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    unused = {inner for node in ast.walk(tree) if isinstance(node, ast.If)
              and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING" for inner in ast.walk(node)}
    for node in set(ast.walk(tree)) - unused:
        if isinstance(node, ast.Import):
            yield from ((alias.name, False) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module, False
        elif isinstance(node, ast.ImportFrom):
            base = [part for part in package if part][:len(package) + 1 - node.level] + [node.module or ""]
            base = ".".join(filter(None, base))
            for alias in node.names:
                inner = f"{base}.{alias.name}".strip(".")
                yield (inner if inner in MODULES else base), True


def room(name):
    """The room that a module is in: the longest name of the table that it starts with."""
    if name in SIMULATE:
        return "engine.simulate"
    parts = name.split(".")
    return next(found for count in range(len(parts), -1, -1)
                if (found := ".".join(parts[:count])) in FLOORS)


def allowed(name, other):
    own, used = room(name), room(other)
    return own == used or used in FLOORS[own] or ("engine" in FLOORS[own] and other.startswith("engine"))


def test_every_import_goes_down_to_a_floor_that_the_table_names():
    upwards = [f"{name or 'lensfield'} imports {other or 'lensfield'}" for name in MODULES
               for other, relative in imports(name)
               if relative and not allowed(name, other) and (name, other) not in DOORS]
    assert not upwards


def test_the_table_has_no_circles_and_no_rooms_that_are_not_there():
    order = list(FLOORS)
    for own, used in FLOORS.items():
        assert all(other in FLOORS for other in used) and any(room(name) == own for name in MODULES)
    seen, left = set(), {own: {other for other in used if other != own} for own, used in FLOORS.items()}
    left["cli"].discard("")  # its version
    while left:
        ready = [own for own in order if own in left and left[own] <= seen]
        assert ready, f"a circle among {sorted(left)}"
        seen.update(ready)
        left = {own: used for own, used in left.items() if own not in ready}


def test_the_engine_knows_no_blender_and_no_library_that_it_does_not_declare():
    known = sys.stdlib_module_names | ENGINE_LIBRARIES
    unknown = [f"{name} imports {other}" for name in MODULES if name.startswith("engine")
               for other, relative in imports(name) if not relative and other.split(".")[0] not in known]
    assert not unknown


def test_the_package_never_imports_itself_by_name():
    by_name = [f"{name} imports {other}" for name in MODULES for other, relative in imports(name)
               if not relative and other.split(".")[0] in ("lensfield", "bl_ext")]
    assert not by_name


def test_every_folder_of_code_is_installed():
    folders = {".".join(["lensfield", *path.parent.relative_to(ROOT).parts]) for path in MODULES.values()}
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    assert folders == set(declared)


@pytest.mark.parametrize("module", ["lensfield.engine", "lensfield.cli"])
def test_engine_and_command_load_no_blender(module):
    code = f"import sys, {module}; sys.exit('bpy' in sys.modules or 'lensfield.addon' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_package_and_extension_have_one_version():
    package = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extension = tomllib.loads((ROOT / "blender_manifest.toml").read_text())
    assert lensfield.__version__ == package["version"] == extension["version"]


def public_functions(tree):
    """(name, its node, what it takes beside itself) of each public function, method and constructor."""
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
    """What a function takes."""
    given = function.args
    return [*given.posonlyargs, *given.args, *given.kwonlyargs, *filter(None, (given.vararg, given.kwarg))]


def test_public_functions_of_the_engine_say_what_they_take_and_give():
    """So that `make lint` has their types to hold one another by."""
    silent = [f"{module}.{name}" for module, path in MODULES.items()
              if module.startswith("engine")
              for name, function, given in public_functions(ast.parse(path.read_text(encoding="utf-8")))
              if any(each.annotation is None for each in given)
              or (function.returns is None and function.name != "__init__")]
    assert not silent
