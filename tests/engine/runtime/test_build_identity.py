"""Results of another build of the program are not taken for results of this build."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib

import numpy as np
import pytest

from lensfield.engine.pictures.spectral_exr import read_exr, read_parts
from lensfield.engine.runtime.build_identity import (
    build_identity,
    identity_of,
    other_builds_line,
    software,
    sources_identity,
    store,
)
from places import ROOT
from rgb_files import colours

PACKAGES = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
FOLDERS = [package.replace(".", "/").removeprefix("lensfield").lstrip("/") for package in PACKAGES]
TABLES = ("engine/prescription/glasses.csv", "engine/spectral/data/spectra", "engine/spectral/data/refraction",
          "addon/scene")
CONSTANT = re.compile(rb"(?m)^([A-Z][A-Z_]+ = .*?)([0-8])")
C_CONSTANT = re.compile(rb"(?m)^(.*[^\w])([0-8])\b")


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """A copy of the package, as in an installation."""
    copy = tmp_path_factory.mktemp("other") / "lensfield"
    for folder in ("engine", "addon", "commands"):
        shutil.copytree(ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__", "lib", "*.jpg"))
    for name in ("__init__.py", "cli.py", "request.py", "restart.py"):
        shutil.copy(ROOT / name, copy / name)
    return copy


def raised(content, constant):
    """A source with one of its constants increased by one."""
    changed, count = constant.subn(lambda match: match[1] + b"%d" % (int(match[2]) + 1), content, count=1)
    assert count
    return changed


def identities_before_and_after(path, change, identity):
    """An identity before a file is changed, while it is changed, and after it is restored."""
    content = path.read_bytes()
    before = identity()
    path.write_bytes(change(content))
    try:
        return before, identity(), content
    finally:
        path.write_bytes(content)


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder or "lensfield")
def test_a_constant_of_any_package_changes_the_identity(package, folder):
    path = next((path for path in sorted((package / folder).glob("*.py")) if CONSTANT.search(path.read_bytes())),
                package / folder / "__init__.py")
    change = (lambda content: raised(content, CONSTANT)) if CONSTANT.search(path.read_bytes()) else (
        lambda content: content + b"MORE = 1\n")
    before, during, _ = identities_before_and_after(path, change, lambda: sources_identity(package))
    assert during != before == sources_identity(package) == sources_identity()


@pytest.mark.parametrize("table", TABLES)
def test_a_table_of_data_changes_the_identity(package, table):
    place = package / table
    path = place if place.is_file() else next(path for path in sorted(place.rglob("*"))
                                              if path.suffix in (".spd", ".yml", ".osl"))
    before, during, _ = identities_before_and_after(path, lambda content: content + b" ",
                                                   lambda: sources_identity(package))
    assert during != before


@pytest.mark.parametrize("name", sorted(path.name for path in (ROOT / "engine/kernels").iterdir()
                                        if path.suffix in (".c", ".h", ".wgsl")))
def test_a_constant_of_a_loop_changes_the_identity(package, name):
    before, during, _ = identities_before_and_after(
        package / "engine/kernels" / name, lambda content: raised(content, C_CONSTANT),
        lambda: sources_identity(package))
    assert during != before == sources_identity()


def test_a_package_built_without_its_c_sources_has_the_identity_of_the_sources(tmp_path):
    store(ROOT, tmp_path)
    assert identity_of(tmp_path) == build_identity() == sources_identity() != sources_identity(tmp_path)


def test_a_moved_source_changes_the_identity_and_an_unrelated_file_does_not(package):
    before = sources_identity(package)
    (package / "engine/notes.txt").write_text("not a source")
    assert sources_identity(package) == before
    (package / "engine/simulation/report.py").rename(package / "engine/reports.py")
    try:
        assert sources_identity(package) != before
    finally:
        (package / "engine/reports.py").rename(package / "engine/simulation/report.py")


def test_a_line_reports_the_frames_of_other_builds():
    ours = build_identity()
    assert other_builds_line([ours, None], False, "rendered") == []
    assert other_builds_line([ours, None, "0123", "4567"], False, "rendered") == [
        "2 of 4 frames come from another build of Lensfield: rendered again; --any-build accepts them"]
    assert other_builds_line([ours, "0123"], True, "rendered") == [
        "1 of 2 frames come from another build of Lensfield: accepted by --any-build"]


def lensfield(folder, package, *more):
    """Filter a sequence in a separate process, by this build or by another package; returns its output."""
    environment = os.environ | {"LENSFIELD_CACHE": str(folder / "cache")} | (
        {"PYTHONPATH": str(package.parent)} if package else {})
    return subprocess.run(
        [sys.executable, "-c", "from lensfield.cli import console; console()", "filter", "shot_####.exr",
         "--output", "out_####.exr", "--lens", "edmund-54852", "--wavelengths", "500,600", "--accuracy", "0.1",
         "--report", "report.json", *more],
        cwd=folder, env=environment, capture_output=True, text=True, check=True).stdout


def test_frames_and_caches_of_another_build_are_not_used(package, tmp_path):
    """Another build doubles the irradiance: its command filters this build's frames again."""
    source = package / "engine/simulation/simulate.py"
    ours = source.read_text(encoding="utf-8")
    doubled = ours.replace("irradiance[index] = merge_pixels(", "irradiance[index] = 2 * merge_pixels(")
    assert doubled != ours
    source.write_text(doubled, encoding="utf-8")
    try:
        for frame in (1, 2):
            colours(tmp_path / f"shot_{frame:04d}.exr", (0.2, 0.5, 0.4), (12, 16))
        assert "another build" not in lensfield(tmp_path, None)
        first = read_exr(tmp_path / "out_0001.exr").cube
        plans = set((tmp_path / "cache/plans").iterdir())
        assert lensfield(tmp_path, package, "--any-build").splitlines()[:2] == [
            "2 of 2 frames come from another build of Lensfield: accepted by --any-build",
            "2 of 2 frames are finished: 0 to filter"]
        assert np.array_equal(read_exr(tmp_path / "out_0001.exr").cube, first)
        printed = lensfield(tmp_path, package)
        assert printed.startswith("2 of 2 frames come from another build of Lensfield: filtered again")
        # numpy's loops round differently
        np.testing.assert_allclose(read_exr(tmp_path / "out_0001.exr").cube, 2 * first, rtol=5e-6)
        assert set((tmp_path / "cache/plans").iterdir()) > plans
        assert "2 of 2 frames are finished" in (again := lensfield(tmp_path, package))
        assert "another build" not in again
    finally:
        source.write_text(ours, encoding="utf-8")


def test_reports_and_headers_name_the_build(tmp_path):
    colours(tmp_path / "shot_0001.exr", (0.2, 0.5, 0.4), (12, 16))
    lensfield(tmp_path, None)
    header, _ = read_parts(tmp_path / "out_0001.exr", header_only=True)[0]
    assert header["software"] == software() == f"Made by Lensfield (build {build_identity()})"
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["software"] == software() and report["frames"][0]["build"] == build_identity()
