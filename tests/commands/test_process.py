"""The command's process: requests to `serve`, and signals at any moment."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from lensfield.commands.serve import Requests
from lensfield.engine.runtime.messages import read_message
from signalled import signalled

SERVE = [sys.executable, "-c", "from lensfield.cli import console; console()", "serve"]

@pytest.fixture(scope="module")
def server():
    with subprocess.Popen(SERVE, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        yield process
        process.stdin.close()
        assert process.wait() == 130


def answers(process, line):
    """The server's response to a line, before it responds to the next one."""
    process.stdin.write(line + b"\n" + json.dumps(["--version"]).encode() + b"\n")
    process.stdin.flush()
    messages = []
    while messages[-1:] != [{"status": 0}]:
        response = process.stdout.readline()
        assert response, "the server has ended"
        messages += filter(None, [read_message(response.decode())])
    return messages[:-1]


@pytest.mark.parametrize("line, error", [
    (b"", "line is empty"), (b"apply a.exr", "line is apply a.exr"), (b"[", "line is ["), (b"{}", "line is {}"),
    (b'"lens"', "line is"), (b"null", "line is null"), (b"NaN", "line is NaN"), (b"[NaN]", "line is [NaN]"),
    (b"-Infinity", "line is -Infinity"), (b'["lens", 1]', "line is"), (b'["lens", null]', "line is"),
    (b'["lens", ["list"]]', "line is"), (b"9" * 10**5, "line is 999"), (b"[" * 10**5, "line is [[["),
    (b'["' + b"n" * 3 * 10**6 + b'"]', "line is over 1048576 bytes"), (b"\xff\xfe[]", "line is not in UTF-8"),
    (b"\0", "line is ?"), (rb'["lens", "info", "a\u0000b"]', "argument 2 is a?b"),
    (rb'["lens", "info", "\ud800"]', "argument 2 is ?"), (b'["serve"]', "command is serve")])
def test_a_malformed_line_gets_an_error_and_the_process_continues(server, line, error):
    answer, = answers(server, line)
    assert answer["status"] == 2 and answer["error"].startswith(f"serve: {error}") and answer["error"].isprintable()


@pytest.mark.parametrize("arguments, status", [
    ([], 2), (["engrave"], 2), (["lens"], 2), (["lens", "info"], 2), (["filter", "--width", "nan"], 2),
    (["lens", "info", "n" * 10**5], 1), (["lens", "list", "--end-with-stdin"], 2)])
def test_an_invalid_command_returns_its_status(server, arguments, status):
    assert answers(server, json.dumps(arguments).encode()) == [{"status": status}]


OPEN = """
from lensfield.commands.blend import import_addon
import_addon()
import bpy
print(bpy.app.tempdir, flush=True)
input()
"""


@pytest.mark.skipif(os.name != "posix", reason="Windows does not report which processes are running")
def test_the_temporary_folder_of_a_killed_blender_is_removed_by_the_next_process(tmp_path):
    def start():
        process = subprocess.Popen([sys.executable, "-c", OPEN], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                   text=True, env=os.environ | {"TMPDIR": str(tmp_path)})
        return process, Path(process.stdout.readline().strip())

    (killed, left), (running, own) = start(), start()
    assert left.is_dir() and own.is_dir() and left.parent == own.parent == tmp_path
    killed.kill()
    killed.wait()
    (tmp_path / "blender_another").mkdir()  # of a Blender without Lensfield
    last, newest = start()
    assert not left.exists() and own.is_dir() and newest.is_dir() and (tmp_path / "blender_another").is_dir()
    for process in (running, last):
        process.communicate("\n")


def test_a_stop_has_no_answer_and_concerns_only_the_request_before_it(server):
    assert answers(server, b'"stop"') == []
    assert answers(server, json.dumps(["preview"]).encode()) == [{"status": 1}]
    requests = Requests()
    for line in (b'"stop"\n', b"[1]\n", b"[2]\n", b'"stop"\n', b"[3]\n"):
        requests.hear(line)
    assert [(line, stop.is_set()) for line, stop in (requests.next() for _ in range(3))] == [
        (b"[1]\n", False), (b"[2]\n", True), (b"[3]\n", False)]


@pytest.mark.skipif(os.name != "posix", reason="Windows ends a process by Ctrl-C itself")
@pytest.mark.parametrize("count", [1, 2, 3, 10, 40, 100, 200, 300, 400])
def test_ctrl_c_during_imports_ends_the_command_without_a_traceback(count):
    completed = signalled(count)
    assert (completed.returncode, completed.stdout, completed.stderr) == (130, "", "\nlensfield: cancelled\n")


@pytest.mark.skipif(os.name != "posix", reason="Windows ends a process by Ctrl-C itself")
def test_nothing_large_is_imported_before_signals_are_handled():
    code = "import sys; before = set(sys.modules); import lensfield.cli; print(*sorted(set(sys.modules) - before))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert {name.split(".")[0] for name in loaded} <= {
        "lensfield", "signal", "enum", "types", "operator", "_operator", "functools", "collections", "_collections",
        "keyword", "reprlib", "_functools", "itertools", "threading", "_weakrefset", "contextlib"}
    assert not [name for name in loaded if name.startswith(("lensfield.engine", "lensfield.commands"))]


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no SIGHUP on this system")
def test_nohup_keeps_a_command_running():
    completed = signalled(1, signal_name="SIGHUP", preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))
    assert completed.returncode == 0 and "edmund-54852" in completed.stdout
    assert signalled(1, signal_name="SIGHUP").returncode == 130
