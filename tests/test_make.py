"""The Makefile and CI run every part of the tests, and fail if one part fails."""

import os
import shutil
import subprocess

import pytest

from places import ROOT

PARTS = ["test-engine", "test-blender"]
pytestmark = pytest.mark.skipif(not shutil.which("make"), reason="make is not installed")


def run_with_fake_make(folder, command, failing):
    """(exit status, output, targets) of a command; its `make` only records its target, and fails for some targets."""
    fake, targets = folder / "make", folder / "targets"
    fake.write_text(f'#!/bin/sh\nfor target in "$@"; do :; done\necho "$target $SEED" >> {targets}\n'
                    f'case " {" ".join(failing)} " in *" $target "*) exit 1;; esac\n')
    fake.chmod(0o755)
    surrounding = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}
    completed = subprocess.run(command(fake), cwd=ROOT, capture_output=True, text=True,
                               env=surrounding | {"SEED": "-5", "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"})
    return completed.returncode, completed.stdout, targets.read_text().splitlines()


@pytest.mark.parametrize("failing", [[], PARTS[:1], PARTS[1:], PARTS])
def test_blender_tests_run_even_if_engine_tests_fail_and_both_are_reported(tmp_path, failing):
    status, output, targets = run_with_fake_make(tmp_path, lambda fake: [
        shutil.which("make"), "test", f"MAKE={fake}", "BPY=5.0.1", "--assume-old=.venv/.ready", "--assume-old=kernels"],
        failing)
    assert targets == [f"{part} -5" for part in PARTS] and (status != 0) == bool(failing)
    verdict = f"failed: {' '.join(failing)}" if failing else f"passed: {' '.join(PARTS)}"
    assert output.splitlines()[-1] == f"make test with SEED=-5: {verdict}"


@pytest.mark.parametrize("failing", [[], ["lint"], ["ci"]])
def test_ci_tests_even_if_lint_fails_and_states_its_seed(tmp_path, failing):
    status, output, targets = run_with_fake_make(tmp_path, lambda fake: [ROOT / ".ci" / "run"], failing)
    assert targets == ["lint -5", "ci -5"] and status == bool(failing)
    assert "SEED=-5" in output.splitlines() and output.endswith(f"SEED=-5: {'failed' if failing else 'passed'}\n")


def test_ci_takes_its_seed_from_the_time(tmp_path, monkeypatch):
    monkeypatch.delenv("SEED", raising=False)
    (tmp_path / "date").write_text("#!/bin/sh\necho 1234567\n")
    (tmp_path / "date").chmod(0o755)
    _, output, targets = run_with_fake_make(tmp_path, lambda fake: ["env", "-u", "SEED", ROOT / ".ci" / "run"], [])
    assert targets == ["lint 1234567", "ci 1234567"] and "SEED=1234567" in output.splitlines()


def test_heavy_tests_exist():
    """If one was renamed, rename it in tests/heavy.txt, too."""
    for name in (ROOT / "tests" / "heavy.txt").read_text().splitlines():
        path, _, function = name.partition("::")
        assert f"def {function}(" in (ROOT / path).read_text(encoding="utf-8"), name
