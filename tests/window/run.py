"""A real window of a real Blender, driven as by a user: `make ui-test BLENDER=/path/to/blender`.

    python tests/window/run.py BLENDER ZIP FOLDER [STEP ...]

installs the extension's zip into a separate user folder and runs the steps of `steps.py` (all, unless some are named),
each in a separate Blender. It needs an X display, or Xvfb to create one; and ImageMagick's `import`, for the
screenshots, which are stored in the folder with each step's files and its log. The exit status is 0 if all steps have
passed.
"""

import ast
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from waiting import LAST_RESORT_S  # noqa: E402

HERE = Path(__file__).parent
STEPS = [node.name for node in ast.parse((HERE / "steps.py").read_text(encoding="utf-8")).body
         if isinstance(node, ast.FunctionDef)]
STEP_S = 2 * LAST_RESORT_S  # a wait within a step ends earlier
SIZE = "1600x900"


@contextmanager
def display():
    """The environment of a Blender that has a display."""
    if os.environ.get("DISPLAY"):
        yield os.environ
        return
    reader, writer = os.pipe()
    server = subprocess.Popen(["Xvfb", "-displayfd", str(writer), "-screen", "0", f"{SIZE}x24", "-nolisten", "tcp"],
                              pass_fds=[writer], stderr=subprocess.DEVNULL)
    os.close(writer)
    with os.fdopen(reader) as numbers:
        number = numbers.readline().strip()
    try:
        yield os.environ | {"DISPLAY": f":{number}", "LIBGL_ALWAYS_SOFTWARE": "1"}
    finally:
        server.terminate()


def take(step, blender, package, folder, environment):
    """Run a step; returns the error, or an empty string."""
    place = folder / step
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    width, height = SIZE.split("x")
    command = [blender, "--enable-event-simulate", "--window-geometry", "0", "0", width, height, "--python",
               HERE / "inside.py", "--", step, package, place]
    with open(place / "log.txt", "w", encoding="utf-8") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, env=environment, start_new_session=True)
    try:
        status = process.wait(STEP_S)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return f"not done within {STEP_S} s"
    try:
        report = json.loads((place / "outcome.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return f"Blender ended by itself, with exit status {status}"
    if report["wrong"]:
        return report["wrong"]
    if status != report["status"]:
        return f"Blender's exit status is {status}, not {report['status']}"
    return left_over(report["gone"])


def left_over(things):
    """The processes and files that should disappear but do not, as text; empty if all disappear."""
    deadline = time.monotonic() + LAST_RESORT_S
    while left := [thing for thing in things if exists(thing)]:
        if time.monotonic() > deadline:
            return f"still there: {', '.join(map(str, left))}"
        time.sleep(0.05)
    return ""


def exists(thing):
    """Whether this file exists, or a process with this id is running."""
    if isinstance(thing, str):
        return os.path.exists(thing)
    try:
        return Path(f"/proc/{thing}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def main(blender, package, folder, *steps):
    folder = Path(folder).resolve()
    missing = [tool for tool in ("import", *(() if os.environ.get("DISPLAY") else ("Xvfb",)))
               if not shutil.which(tool)]
    if missing:
        sys.exit(f"make ui-test: please install {' and '.join(missing)} (Debian: apt-get install imagemagick xvfb)")
    user = folder / "user"
    if not steps or steps[0] == STEPS[0]:
        shutil.rmtree(user, ignore_errors=True)
    (user / "config").mkdir(parents=True, exist_ok=True)  # Blender ignores a user folder that does not exist
    failed = 0
    with display() as environment:
        for step in steps or STEPS:
            start_s = time.monotonic()
            wrong = take(step, blender, Path(package).resolve(), folder,
                         {**environment, "BLENDER_USER_RESOURCES": str(user)})
            failed += bool(wrong)
            took_s = time.monotonic() - start_s
            print(f"{'FAILED' if wrong else 'passed':8}{step:20}{took_s:6.1f} s  {wrong}", flush=True)
    print(f"{failed} of {len(steps or STEPS)} steps failed; screenshots are in {folder}")
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
