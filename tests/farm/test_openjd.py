"""The Open Job Description template, run by openjd's own command."""

import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from kill import differing

from lensfield.cli import main
from small_farm import LENSFIELD, OPTIONS, interrupted, passes, renders
from waiting import wait_until

pytest.importorskip("openjd.cli", reason="openjd-cli is not installed: make test-farm")
OPENJD = Path(sys.executable).with_name("openjd")


@pytest.fixture
def on_path(tmp_path, monkeypatch):
    """The `lensfield` command, as installed on a farm's machines."""
    command = tmp_path / "bin" / "lensfield"
    command.parent.mkdir()
    command.write_text(f"#!/bin/sh\nexec {shlex.join(LENSFIELD)} \"$@\"\n")
    command.chmod(0o755)
    monkeypatch.setenv("PATH", str(command.parent), prepend=":")


def write_job(blend, folder, *more):
    """A job that renders into `folder`, as arguments for openjd."""
    assert main(["farm", "openjd", str(blend), *OPTIONS, "--output", str(folder), "--job", str(folder.parent / "job"),
                 *more]) == 0
    template, values = (folder.parent / "job" / f"{name}.yaml" for name in ("template", "parameter_values"))
    values = yaml.safe_load(values.read_text(encoding="utf-8"))["parameterValues"]
    return [str(template), *(word for value in values for word in ("-p", f"{value['name']}={value['value']}"))]


def run(*words):
    return subprocess.run([OPENJD, *words], capture_output=True, text=True, stdin=subprocess.DEVNULL)


@pytest.mark.parametrize("more", [(), ("--frames-per-task", "3"), ("--frames", "1-10000:2,7"),
                                  ("--blender", "/opt/blender 5/blender", "--view-layer", "-é \"'")])
def test_openjd_accepts_the_job(blend, tmp_path, more):
    template, *_ = write_job(blend, tmp_path / "ö out", *more)
    checked = run("check", template)
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_a_job_with_a_killed_worker_loses_no_frames_and_leaves_no_files(blend, serial, tmp_path, on_path):
    folder = tmp_path / "ö out"
    job = write_job(blend, folder)
    worker = subprocess.Popen([OPENJD, "run", *job], stdout=subprocess.PIPE, stdin=subprocess.DEVNULL)
    wait_until(lambda: passes(folder) and renders(folder))
    worker.send_signal(signal.SIGKILL)
    worker.communicate()
    wait_until(lambda: not renders(folder))
    assert interrupted(folder)
    completed = run("run", *job)
    assert completed.returncode == 0, completed.stdout + completed.stderr
    assert "openjd_progress: " in completed.stdout and "openjd_status: Frame 2, 1 of 1: " in completed.stdout
    assert differing(serial, folder) == []


def test_a_failed_job_reports_the_reason(blend, tmp_path, on_path):
    completed = run("run", *write_job(blend, tmp_path / "out", "--frames-per-task", "2", "--view-layer", "none such"))
    assert completed.returncode == 1
    assert "openjd_fail: " in completed.stdout and "none such" in completed.stdout
