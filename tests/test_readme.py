"""Links, paths, make targets, command lines and names from the code in the documents exist."""

import re
import shlex
from functools import cache

import pytest

import rooms
from lensfield import cli
from places import ROOT

PAGES = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md",
         *sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob("docs/**/*.md"))]
FOLDERS = "addon", "benchmarks", "commands", "docs", "engine", "packaging", "sample_scenes", "tests", "validation"
LINK = re.compile(r"\]\(([^)\s]+)\)|src=\"([^\"]+)\"")
PICTURES = ".gif", ".jpg", ".png", ".svg", ".webp"
PATH = re.compile(rf"(?<![\w/.-])(?:{'|'.join(FOLDERS)})/[\w./*-]*[\w*/]")
PLACEHOLDER = re.compile(r"NAME|PROGRAM")
CODE_LINE, SPAN = re.compile(r"(?m)^ {4}(\S.*)$"), re.compile(r"`([^`\n]+)`")
NOT_OURS = {"git", "make"}


def text(page):
    return (ROOT / page).read_text(encoding="utf-8")


def anchors(page):
    """The anchors that GitHub generates from a page's headings."""
    return {re.sub(r"[^\w -]", "", line.lstrip("# ").lower()).replace(" ", "-")
            for line in text(page).splitlines() if line.startswith("#")}


@pytest.mark.parametrize("page", PAGES)
def test_links_have_targets(page):
    for link in filter(None, (target for pair in LINK.findall(text(page)) for target in pair)):
        if not link.startswith("http"):
            path, _, anchor = link.partition("#")
            target = ROOT / page if not path else (ROOT / page).parent / path
            assert target.exists(), link
            assert not anchor or anchor in anchors(target), link


@pytest.mark.parametrize("page", PAGES)
def test_pictures_are_small(page):
    """For readers on a phone."""
    pictures = {(ROOT / page).parent / target for pair in LINK.findall(text(page)) for target in pair
                if target.endswith(PICTURES)}
    assert not {f"{path.name}: {path.stat().st_size} bytes" for path in pictures if path.stat().st_size > 300_000}


@pytest.mark.parametrize("page", PAGES)
def test_paths_exist(page):
    assert not [path for path in PATH.findall(text(page))
                if not PLACEHOLDER.search(path) and not list(ROOT.glob(path.rstrip("/")))]


@cache
def words_of_the_code():
    files = [*(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")),
             ROOT / "Makefile", ROOT / "pyproject.toml"]
    return {word for path in files for word in re.findall(r"\w+", path.read_text(encoding="utf-8"))}


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "docs/architecture.md"])
def test_names_exist_in_the_code(page):
    """A name in backticks, with or without arguments, is a function, a field or a module."""
    names = {span.partition("(")[0] for span in SPAN.findall(text(page))}
    names = {name for name in names if name.replace(".", "").isidentifier() and not PLACEHOLDER.search(name)}
    assert len(names) > 30
    assert not {name for name in names - NOT_OURS if not words_of_the_code() >= set(name.split("."))}


@pytest.mark.parametrize("page", PAGES)
def test_make_targets_exist(page):
    targets = set(re.search(r"\.PHONY:((?:\\\n|.)*)", text("Makefile"))[1].replace("\\", "").split())
    code = [*CODE_LINE.findall(text(page)), *SPAN.findall(text(page))]
    assert {word for line in code for word in re.findall(r"\bmake ([a-z][a-z-]*)", line.partition(" # ")[0])} <= targets


@pytest.mark.ci_only
def test_command_lines_are_valid():
    lines = [re.sub(r"\s+#\s.*|\s…", "", line) for page in PAGES for line in CODE_LINE.findall(text(page))]
    lines = [line for line in lines if re.match(r"(\S+/bin/)?lensfield ", line)]
    assert len(lines) > 12
    for line in lines:
        try:
            cli._parser().parse_args(shlex.split(line)[1:])
        except SystemExit as stop:  # of --version
            assert stop.code == 0, line


@pytest.mark.ci_only
def test_the_python_code_in_the_readme_runs(capsys):
    for code in re.findall(r"(?s)```python\n(.*?)```", text("README.md")):
        exec(compile(code, "README.md", "exec"), {})
    assert capsys.readouterr().out.startswith("(3, 240, 320)")


@pytest.mark.parametrize("page", PAGES)
def test_named_commands_exist(page, capsys):
    for span in SPAN.findall(text(page)):
        if named := re.match(r"lensfield ([a-z -]*[a-z])\b", span):
            with pytest.raises(SystemExit) as stop:
                cli._parser().parse_args([*named[1].split(), "--help"])
            assert stop.value.code == 0, span


def test_the_graph_of_the_rooms_is_up_to_date():
    """If it is not, run `python docs/figures/rooms.py docs/architecture.md`."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert rooms.with_graph(text) == text
