"""`--untrusted`: a command on an untrusted picture, confined to certain folders, with limits."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from argparse import ArgumentParser
from importlib import import_module

import numpy as np
import pytest

from lensfield.cli import _parser, main
from lensfield.commands import confine, serve, untrusted
from lensfield.commands.parser import COMMANDS
from lensfield.commands.task import task_arguments
from lensfield.engine import InputError
from lensfield.engine.runtime.messages import read_message
from places import ROOT
from rgb_files import planes_exr

pytestmark = pytest.mark.skipif(os.name != "posix", reason="Windows has no limits, links and pipes to try")
QUICK = "--lens", "edmund-54852", "--method", "paper", "--section-size", "8", "--wavelengths", "450,550,650"


@pytest.fixture
def picture(tmp_path):
    """A picture of 24 x 15 px in a separate folder."""
    (tmp_path / "job").mkdir()
    path = tmp_path / "job" / "picture.exr"
    planes_exr(path, {name: np.full((15, 24), value, np.float32) for name, value in zip("RGB", (0.2, 0.5, 0.3),
                                                                                     strict=True)})
    return path


def filtered(capfd, picture, output, *more):
    status = main(["filter", str(picture), "--output", str(output), *QUICK, "--untrusted", *map(str, more)])
    return status, "".join(capfd.readouterr())


def test_a_confined_process_gives_the_same_picture(picture, tmp_path, capfd):
    status, printed = filtered(capfd, picture, tmp_path / "out" / "confined.exr")
    assert status == 0, printed
    assert main(["filter", str(picture), "--output", str(tmp_path / "free.exr"), *QUICK]) == 0
    assert (tmp_path / "out" / "confined.exr").read_bytes() == (tmp_path / "free.exr").read_bytes()


def test_links_outside_the_folder_are_refused(picture, tmp_path, capfd):
    (tmp_path / "away").mkdir()
    away = shutil.move(picture, tmp_path / "away" / "picture.exr")
    picture.symlink_to(away)
    status, printed = filtered(capfd, picture, tmp_path / "out" / "picture.exr")
    assert status == 1 and "picture.exr: file is outside the scene's folder and --root" in printed
    assert filtered(capfd, picture, tmp_path / "out" / "picture.exr", "--root", away.parent)[0] == 0


def test_outputs_outside_the_output_folder_are_refused(picture, tmp_path, capfd):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "link.png").symlink_to(tmp_path / "away.png")
    for preview in (tmp_path / "out" / "link.png", tmp_path / "away.png"):
        status, printed = filtered(capfd, picture, tmp_path / "out" / "picture.exr", "--preview", preview)
        assert status == 1 and "file is outside --output: --untrusted writes files below --output only" in printed
    assert not (tmp_path / "away.png").exists() and not list((tmp_path / "out").glob("*.exr"))


@pytest.mark.parametrize("more, message", [
    (("--root", "x"), "--root is given without --untrusted: give both"),
    (("--time-limit", "5"), "--time-limit is given without --untrusted: give both"),
    (("--untrusted", "--memory-limit", "0.1"), "--memory-limit is 0.1: expected 2.0 to"),
    (("--untrusted", "--time-limit", "0"), "--time-limit is 0.0: expected 1.0 to")])
def test_limits_are_checked(picture, tmp_path, capfd, more, message):
    assert main(["filter", str(picture), "--output", str(tmp_path / "out.exr"), *QUICK, *more]) == 1
    assert message in capfd.readouterr().err


def test_serve_confines_each_of_its_commands(picture, tmp_path):
    command = [sys.executable, "-c", "from lensfield.cli import console; console()", "serve", "--untrusted"]
    lines = [["filter", str(picture), "--output", str(tmp_path / "out" / "a.exr"), *QUICK],
             ["filter", str(picture), "--output", str(tmp_path / "b.exr"), "--preview", str(tmp_path / "out" / "b.png"),
              *QUICK], ["filter", str(picture), "--output", str(tmp_path / "b.exr"), *QUICK, "--report",
                        str(tmp_path.parent / "report.json")], ["lens", "list"]]
    served = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    with served:
        statuses = []
        for line in lines:
            print(json.dumps(line), file=served.stdin, flush=True)
            while "status" not in (facts := read_message(served.stdout.readline()) or {}):
                pass
            statuses.append(facts["status"])
        served.stdin.close()
        printed = served.stderr.read()
    assert statuses == [0, 0, 1, 2] and "report.json: file is outside --output" in printed


@pytest.mark.parametrize("option", ["--root=/", "--root", "--roo=/", "--time-limit=1e6", "--memory-limit", "--time"])
def test_lines_cannot_change_the_limits_of_serve(option):
    with pytest.raises(InputError, match="^serve: option is --.*: give it to serve --untrusted itself"):
        serve._confined(["render", "a.blend", option, "/"], ["--untrusted"])
    assert serve._confined(["render", "a.blend", option, "/"], []) == ["render", "a.blend", option, "/"]


def test_all_other_options_pass_through_serve():
    arguments = ["filter", "a.exr", "--report", "r.json", "--resolution=8x8", "--", "-"]
    assert serve._confined(arguments, ["--untrusted"]) == arguments


@pytest.mark.parametrize("value", ["1", "", "yes", "0" * 64])
def test_a_variable_in_the_environment_does_not_skip_the_confinement(picture, tmp_path, capfd, monkeypatch, value):
    """Even if the temporary folder has a file of limits."""
    (tmp_path / "limits.json").write_text(json.dumps({"token": "another"}))
    for name in ("TMPDIR", "TMP", "TEMP"):
        monkeypatch.setenv(name, str(tmp_path))
    monkeypatch.setenv(untrusted.CONFINED, value)
    started, start = [], untrusted._start
    monkeypatch.setattr(untrusted, "_start", lambda *given: started.append(given) or start(*given))
    status, printed = filtered(capfd, picture, tmp_path / "out" / "a.exr")
    assert status == 0 and len(started) == 1, printed


def test_the_guide_names_all_commands_that_can_be_confined():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["lensfield"])
        parsers = {name: ArgumentParser() for name in COMMANDS}
        for name, parser in parsers.items():
            import_module(f"lensfield.commands.{name}").add_options(parser)
    named = {name for name, parser in parsers.items() if "--untrusted" in parser._option_string_actions}
    text, = re.findall(r"([^\n]*\n?[^\n]*) take `--untrusted`", (ROOT / "docs" / "farm.md").read_text(encoding="utf-8"))
    assert set(re.findall("`([a-z]+)`", text)) == named


def test_farm_tasks_have_the_same_limits(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = _parser().parse_args(["render", "scene.blend", "--untrusted", "--root", "a", "--root", "/b",
                                    "--time-limit", "60", "--output", "out"])
    assert task_arguments(options) == [f"--output={tmp_path / 'out'}", "--untrusted", f"--root={tmp_path / 'a'}",
                                       "--root=/b", "--time-limit=60.0"]


def test_a_process_that_never_ends_is_terminated():
    process = subprocess.Popen([sys.executable, "-c", "import signal; signal.pause()"],
                               start_new_session=sys.platform == "linux")
    with pytest.raises(InputError, match="^scene.blend: time limit is 0.5 s: exceeded: --time-limit$"):
        untrusted._wait(process, "scene.blend", 0.5)
    assert process.returncode == -signal.SIGTERM


@pytest.mark.skipif(sys.platform != "linux", reason="others let the process go on until its own limits")
def test_killing_the_starter_ends_the_confined_process(tmp_path):
    """No process remains after the kill: the pipe ends only when all processes that hold it have ended."""
    limits = tmp_path / "limits.json"
    limits.write_text(json.dumps({"read": ["/"], "write": [], "memory_bytes": 4 * 10**9, "cpu_s": 600}))
    command = [sys.executable, "-I", confine.__file__, str(limits), sys.executable, "-c",
               "import signal; print('runs', flush=True); signal.pause()"]
    starter = subprocess.Popen([sys.executable, "-c", f"import subprocess; subprocess.run({command!r})"],
                               stdout=subprocess.PIPE, text=True)
    with starter:
        assert starter.stdout.readline() == "runs\n"
        starter.kill()
        assert starter.stdout.read() == ""


@pytest.mark.skipif(sys.platform != "linux", reason="others keep no limit on memory")
def test_memory_is_limited(tmp_path):
    limits = tmp_path / "limits.json"
    limits.write_text(json.dumps({"read": ["/"], "write": [], "memory_bytes": 2 * 10**9, "cpu_s": 600}))
    completed = subprocess.run([sys.executable, "-I", confine.__file__, str(limits), sys.executable, "-c",
                                "bytearray(10**9); bytearray(3 * 10**9)"], capture_output=True, text=True)
    assert completed.returncode == 1 and completed.stderr.endswith("MemoryError\n")


def test_a_system_without_landlock_is_reported(picture, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(untrusted, "landlock_version", lambda: 0)
    status, printed = filtered(capfd, picture, tmp_path / "out" / "picture.exr")
    assert status == 0 and "untrusted: this system cannot confine a process (Landlock)" in printed
