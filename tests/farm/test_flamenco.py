"""Flamenco's job type: its script in Node, and its tasks as a worker runs them."""

import json
import shlex
import shutil
import signal
import subprocess
import sys

import pytest
from kill import differing

from lensfield.cli import main
from places import ROOT
from small_farm import LENSFIELD, interrupted, passes, renders
from waiting import wait_until

pytestmark = pytest.mark.ci_only
SCRIPT = ROOT / "docs" / "lensfield_render.js"
MANAGER = r"""
const taken = [];
const author = {
    Task: (name, type) => ({ name, type, commands: [], addCommand(command) { this.commands.push(command); } }),
    Command: (name, parameters, steps) => ({ name, parameters, steps }),
};
function explode(text) {
    const frames = new Set();
    for (const part of text.split(",")) {
        const [first, last] = part.split("-").map(each => parseInt(each.trim(), 10));
        for (let frame = first; frame <= (last ?? first); frame++) frames.add(frame);
    }
    return [...frames].sort((a, b) => a - b);
}
function merge(frames) {
    const ranges = [];
    for (const frame of frames) {
        const last = ranges[ranges.length - 1];
        if (last && last[1] + 1 === frame) last[1] = frame; else ranges.push([frame, frame]);
    }
    return ranges.map(([a, b]) => a === b ? `${a}` : b === a + 1 ? `${a},${b}` : `${a}-${b}`).join(",");
}
function frameChunker(text, size) {
    const frames = explode(text), chunks = [];
    for (let at = 0; at < frames.length; at += size) chunks.push(merge(frames.slice(at, at + size)));
    return chunks;
}
const frameCount = text => explode(text).length;
"""
"""The part of the Manager's script interface that this script uses."""
WORKER = """
import subprocess, sys
task = subprocess.Popen(sys.argv[1:], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
for line in task.stdout:
    sys.stdout.buffer.write(line)
sys.exit(task.wait())
"""


def in_node(code):
    if not shutil.which("node"):
        pytest.skip("there is no Node to run the script in")
    node = subprocess.run(["node", "-e", f'"use strict";{MANAGER}\n{SCRIPT.read_text()}\n{code}'], capture_output=True,
                          text=True)
    assert node.returncode == 0, node.stderr
    return json.loads(node.stdout)


def compiled(**settings):
    """The tasks of a job."""
    job = {"settings": {"frames": "1", "chunk_size": 1, "output_folder": "/out", "overwrite": False,
                        "scene_name": "Scene", "lens": "tessar-50mm", "blendfile": "/scene.blend"} | settings}
    return in_node(f"""
        const job = {json.dumps(job)};
        job.addTask = task => taken.push(task);
        compileJob(job);
        console.log(JSON.stringify(taken));""")


@pytest.mark.parametrize("frames, size, chunks", [
    ("1-3", 3, ["1-3"]), ("1,2", 2, ["1,2"]), ("7", 1, ["7"]), ("1-5, 9", 2, ["1,2", "3,4", "5,9"])])
def test_chunks_of_frames_become_tasks(frames, size, chunks):
    tasks = compiled(frames=frames, chunk_size=size)
    assert [task["name"] for task in tasks] == [f"render-{chunk}" for chunk in chunks]
    assert {task["type"] for task in tasks} == {"blender"}
    for task, chunk in zip(tasks, chunks, strict=True):
        command, = task["commands"]
        assert command["name"] == "blender-render" and f"--frames={chunk}" in command["parameters"]["args"]
        assert command["steps"] == sum(len(range(*map(int, (*part.split("-"), part)[:2]))) + 1 if "-" in part else 1
                                       for part in chunk.split(","))


def test_paths_with_special_characters_are_preserved():
    folder, lens, blend = "/ö d/'q\" $x `y`;", "/lenses/my lens.toml", "/-s {z}/scène.blend"
    task, = compiled(output_folder=folder, lens=lens, blendfile=blend, overwrite=True)
    parameters = task["commands"][0]["parameters"]
    assert parameters["blendfile"] == blend
    assert {f"--output={folder}", f"--lens={lens}", "--overwrite"} < set(parameters["args"])


def test_the_command_line_accepts_the_scripts_arguments(capsys, tmp_path):
    parameters = compiled(overwrite=True)[0]["commands"][0]["parameters"]
    assert parameters["argsBefore"][:3] == ["--background", "--command", "lensfield"]
    assert main([*parameters["argsBefore"][3:], str(tmp_path / "none.blend"), *parameters["args"]]) == 1
    assert "none.blend: scene is missing" in capsys.readouterr().err


def test_job_settings_are_valid_in_flamenco():
    job_type = in_node("console.log(JSON.stringify(JOB_TYPE))")
    for setting in job_type["settings"]:
        assert setting["type"] in ("string", "int32", "float", "bool")
        assert setting.get("visible", "visible") in ("visible", "submission", "web", "hidden")
        compile(setting.get("eval", "None"), setting["key"], "eval")


def test_a_task_with_a_killed_worker_loses_no_frames_and_leaves_no_files(blend, serial, tmp_path):
    """The worker reads Blender's output, and does not provide standard input."""
    blender, folder = tmp_path / "blender", tmp_path / "ö out"
    blender.write_text(f"#!/bin/sh\nshift 3\nexec {shlex.join(LENSFIELD)} \"$@\"\n")
    blender.chmod(0o755)
    task, = compiled(frames="1-2", chunk_size=2, output_folder=str(folder), blendfile=str(blend))
    parameters = task["commands"][0]["parameters"]
    command = [sys.executable, "-c", WORKER, blender, *parameters["argsBefore"], parameters["blendfile"],
               *parameters["args"], "--lens-quality=preview", "--resolution=64x48", "--samples=128"]
    with open(tmp_path / "worker.log", "wb") as log:
        worker = subprocess.Popen(command, stdout=log)
    wait_until(lambda: worker.poll() is not None or passes(folder) and renders(folder))
    worker.send_signal(signal.SIGKILL)
    assert worker.wait() == -signal.SIGKILL, (tmp_path / "worker.log").read_text()
    wait_until(lambda: not renders(folder))
    assert interrupted(folder)
    completed = subprocess.run(command, capture_output=True, text=True)
    assert completed.returncode == 0, completed.stdout
    assert differing(serial, folder) == []
    saved = [line for line in completed.stdout.splitlines() if "Saved: '" in line]
    assert saved == [f"Saved: '{folder / f'ein_ende_Scene_{frame:04d}_after.png'}'" for frame in (1, 2)]
    assert len([line for line in completed.stdout.splitlines() if line.startswith("Time: ")]) == 2
