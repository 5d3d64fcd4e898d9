"""Renders take the seed of the test run, and a render that does not fails only its own test."""

import os
import subprocess
import sys

import pytest

from places import ROOT
from seed import FIRST_CYCLES_SEED, SEED

THREE_TESTS = """
import bpy

def render(scene):
    scene.cycles.samples = scene.render.resolution_x = scene.render.resolution_y = 4
    bpy.ops.render.render()

def test_before(scene):
    render(scene)

def test_culprit(scene):
    scene.cycles.seed = 5
    render(scene)

def test_after(scene):
    render(scene)
"""


@pytest.mark.parametrize("seed, first", [("7", 7000), ("-1", 2_097_151_000)])
def test_an_unshifted_seed_fails_one_test(tmp_path, seed, first):
    (tmp_path / "conftest.py").write_text((ROOT / "tests/addon/conftest.py").read_text())
    (tmp_path / "test_three.py").write_text(THREE_TESTS)
    folders = [str(ROOT / folder) for folder in ("tests/support", "tests/addon")]
    completed = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-W", "ignore", tmp_path],
        capture_output=True, text=True, env=os.environ | {
            "SEED": seed, "PYTHONPATH": os.pathsep.join([*folders, os.environ.get("PYTHONPATH", "")])})
    assert "3 passed, 1 error" in completed.stdout, completed.stdout + completed.stderr
    assert "ERROR at teardown of test_culprit" in completed.stdout
    assert f"rendered with seeds below {first}" in completed.stdout


def test_cycles_uses_the_seed_of_the_run(scene):
    assert scene.cycles.seed == FIRST_CYCLES_SEED == 1000 * SEED
    assert 1000 * 2**21 <= scene.cycles.bl_rna.properties["seed"].hard_max
