"""A Dask cluster on this machine: a scheduler and its workers. The test kills one worker."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from kill import differing

from small_farm import LENSFIELD, OPTIONS, passes, renders
from waiting import wait_until

pytest.importorskip("distributed", reason="distributed is not installed: make test-farm")
DASK = [sys.executable, "-m", "dask"]


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """The address of a scheduler with one worker."""
    folder = tmp_path_factory.mktemp("dask")
    path = folder / "scheduler.json"
    processes = [start(folder, "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", path)]
    wait_until(lambda: path.is_file() and path.read_text().endswith("}"))
    processes.append(start(folder, "worker", "--scheduler-file", path, "--nthreads", "1", "--local-directory", folder))
    yield json.loads(path.read_text())["address"]
    for process in reversed(processes):
        process.terminate()
        process.wait()


def start(folder, *words):
    return subprocess.Popen([*DASK, *map(str, words), "--no-dashboard"], cwd=folder, stdout=subprocess.DEVNULL,
                            stderr=subprocess.DEVNULL)


def command(blend, folder, scheduler, *more):
    return [*LENSFIELD, "render", blend, *OPTIONS, "--output", folder, "--scheduler", scheduler, *more]


def parent(process):
    return int(Path(f"/proc/{process}/stat").read_text().rsplit(")")[1].split()[1])


def test_a_killed_worker_loses_no_frames_and_leaves_no_files(blend, serial, scheduler, tmp_path):
    folder, report = tmp_path / "ö out", tmp_path / "report.json"
    client = subprocess.Popen(command(blend, folder, scheduler, "--report", report, "--progress", "lines"),
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_until(lambda: passes(folder) and renders(folder))
    killed, = renders(folder)
    os.kill(parent(killed), signal.SIGKILL)
    wait_until(lambda: killed not in renders(folder))
    output, errors = client.communicate()
    assert client.returncode == 0, errors
    facts = [json.loads(line.partition("> ")[2]) for line in output.splitlines()]
    assert {fact["frame"] for fact in facts if "frame" in fact} == {1, 2}
    assert facts[-1]["messages"] == ["2 frames finished"]
    assert [frame["frame"] for frame in json.loads(report.read_text())["frames"]] == [1, 2]
    assert differing(serial, folder) == []


def test_a_render_ends_with_its_client(blend, scheduler, tmp_path):
    folder = tmp_path / "out"
    client = subprocess.Popen(command(blend, folder, scheduler), stdout=subprocess.PIPE)
    wait_until(lambda: renders(folder))
    client.kill()
    client.communicate()
    wait_until(lambda: not renders(folder))


def test_failed_frames_are_reported(blend, scheduler, tmp_path):
    client = subprocess.run(command(blend, tmp_path, scheduler, "--frames-per-task", "2", "--view-layer", "none such"),
                            capture_output=True, text=True)
    assert client.returncode == 1
    assert client.stdout.startswith("frames 1-2: ") and "none such" in client.stdout
    assert client.stderr.startswith("lensfield: frames 1-2: render is incomplete: 0 of 2 frames are finished: ")
    assert client.stderr.count("\n") == 1


@pytest.mark.parametrize("more, why", [
    (("--scheduler", "tcp://127.0.0.1:1"), "--scheduler is tcp://127.0.0.1:1: no scheduler answers at this address"),
    (("--frames", "scene"), "--frames is scene: give frame numbers"),
    (("--picture", "so_far.png"), "--picture is so_far.png: not possible with --scheduler"),
    (("--frames-per-task", "0"), "--frames-per-task is 0: expected 1 to")])
def test_impossible_options_are_reported_in_one_line(blend, tmp_path, more, why):
    client = subprocess.run(command(blend, tmp_path, "tcp://127.0.0.1:1", *more), capture_output=True, text=True,
                            env=os.environ | {"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "0.2s"}, cwd=tmp_path)
    assert client.returncode == 1 and why in client.stderr and client.stderr.count("\n") == 1
