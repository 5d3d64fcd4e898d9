"""The public API is as docs/api.md records it, guides use nothing else, and deprecated names are removed in time."""

import ast
import re

import pytest

import api_listing
import lensfield
from lensfield import cli
from places import ROOT

PAGE = api_listing.PAGE.read_text(encoding="utf-8")
GUIDES = ["README.md", *sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob("docs/**/*.md"))]
PYTHON = re.compile(r"(?s)```python\n(.*?)```")
RENEW = ("the public API differs from docs/api.md. If the change is deliberate, and breaks nothing or was deprecated "
         "for a minor version (CONTRIBUTING.md), run `python docs/api_listing.py`, and mention it in CHANGELOG.md")
SOURCES = [ROOT / f"{name}.py" for name in ("__init__", "cli", "request")] + [
    path for folder in ("engine", "addon", "commands") for path in sorted((ROOT / folder).rglob("*.py"))]
REMOVAL = re.compile(r"\bremoved in (\d+)\.(\d+)\.(\d+)\b")


def test_the_page_has_all_listings():
    assert [name for _, name, _ in api_listing.LISTING.findall(PAGE)] == ["python", "command", "formats", "blender"]


@pytest.mark.parametrize("name", ["python", "command", "formats", "blender"])
def test_the_public_api_is_as_recorded(name):
    if name == "blender":
        pytest.importorskip("bpy", reason="no Blender wheel")
    recorded = re.search(rf"<!-- listing: {name} -->\n+```text\n(.*?)\n```", PAGE, re.DOTALL)[1].split("\n")
    now = getattr(api_listing, name)()
    assert {"gone": set(recorded) - set(now), "new": set(now) - set(recorded)} == {"gone": set(), "new": set()}, RENEW
    assert now == recorded, RENEW


def test_changes_of_signatures_options_and_versions_are_noticed(monkeypatch):
    monkeypatch.setattr(lensfield.engine, "load_camera", lambda source, serial=0: None)
    assert "load_camera(source, serial=0)" in api_listing.python() and "load_camera(source, serial=0)" not in PAGE
    lint = cli._parser()._subparsers._group_actions[0].choices["lint"]
    lint.add_argument("--new", default=3, choices=[3, 4], help="new")
    monkeypatch.setattr(cli, "_parser", lambda: lint)
    assert "--new {3,4}  default: 3" in api_listing.command()
    monkeypatch.setattr("lensfield.engine.sensor.film.VERSION", 2)
    assert "lensfield-film         2     film (.toml)" in api_listing.formats()


@pytest.mark.parametrize("status", [0, 1, 2, cli.CANCELLED, cli.UNHEARD])
def test_exit_statuses_are_listed(status):
    assert re.search(rf"^\| {status} \|", PAGE, re.MULTILINE)


@pytest.mark.parametrize("page", GUIDES)
def test_the_guides_import_public_names_only(page):
    public = {f"lensfield.{name}" for name in (*lensfield.__all__, "addon", "cli.main",
                                               "blenderproc.set_lens_distortion")}
    trees = map(ast.parse, PYTHON.findall((ROOT / page).read_text(encoding="utf-8")))
    nodes = [node for tree in trees for node in ast.walk(tree)]
    imported = {f"{node.module}.{each.name}" for node in nodes if isinstance(node, ast.ImportFrom)
                for each in node.names}
    assert {name for name in imported if name.startswith("lensfield")} <= public
    of_addon = {node.attr for node in nodes
                if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "addon"}
    assert of_addon <= {*api_listing.OF_ADDON}


def deprecations(source):
    """The messages of all DeprecationWarnings that a module gives."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and any(isinstance(each, ast.Name) and each.id == "DeprecationWarning"
                                              for given in (*node.args, *(pair.value for pair in node.keywords))
                                              for each in ast.walk(given)):
            yield "".join(each.value for each in ast.walk(node)
                          if isinstance(each, ast.Constant) and isinstance(each.value, str))


def overdue(source, version):
    """The messages of deprecations that state no removal, or one that this version has reached."""
    now = tuple(map(int, version.split(".")))
    return [text for text in deprecations(source)
            if not (stated := REMOVAL.search(text)) or tuple(map(int, stated.groups())) <= now]


def test_deprecated_names_are_removed_in_time():
    late = {path.relative_to(ROOT).as_posix(): texts for path in SOURCES
            if (texts := overdue(path.read_text(encoding="utf-8"), lensfield.__version__))}
    assert not late, "remove these names, or state the version that removes them (CONTRIBUTING.md)"


@pytest.mark.parametrize("version, late", [("0.2.0", 0), ("0.2.9", 0), ("0.3.0", 1), ("0.10.0", 1), ("1.0.0", 1)])
@pytest.mark.parametrize("call", [
    'warnings.warn("bake is deprecated: use load_lens; it is removed in 0.3.0", DeprecationWarning, stacklevel=2)',
    'warn(f"{name} is deprecated and " f"removed in 0.3.0", category=DeprecationWarning)',
    'warn(DeprecationWarning("removed in 0.3.0"))'])
def test_an_overdue_deprecation_is_found(call, version, late):
    assert len(overdue(f"def old():\n    {call}", version)) == late


def test_a_deprecation_states_its_removal():
    assert overdue('warn("old is deprecated", DeprecationWarning)', "0.2.0") == ["old is deprecated"]
    assert not overdue('warn("slow", RuntimeWarning)', "0.2.0")
