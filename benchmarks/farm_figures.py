"""Measure the overhead of farms and the gain from a second worker.

    python benchmarks/farm_figures.py [FRAMES]

in an environment with distributed (make test-farm creates one). The overhead of a task is the difference in processor
seconds between one task per frame and one task for all frames, each the best of several runs. Scaling is measured in
wall-clock time, with one and then two workers on a core each, so it is meaningless on a busy machine.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "support"), str(ROOT / "tests" / "addon"), str(ROOT / "tests" / "reliability")]
LENSFIELD = [sys.executable, "-c", "from lensfield.cli import console; console()"]
SAVE = "import sys; sys.path[:0] = sys.argv[2:]; from kill import save_scene; from lensfield import addon; " \
       "addon.register(); save_scene(sys.argv[1], 64); import os; os._exit(0)"
BEST_OF = 3


def main(frames=4):
    os.environ["LENSFIELD_CACHE"] = tempfile.mkdtemp(prefix="lensfield-figures-")
    work = Path(tempfile.mkdtemp(prefix="lensfield-farm-"))
    blend = work / "scene.blend"
    run([sys.executable, "-c", SAVE, blend, *sys.path[:3]])
    options = ["--frames", f"1-{frames}", "--lens-quality", "preview"]

    def render(name, *more):
        return run([*LENSFIELD, "render", blend, *options, "--output", work / name, *more])

    render("bakes")

    def best_s(text):
        return min(processor_s(lambda: render("alone", "--overwrite", "--frames", text)) for _ in range(BEST_OF))

    task_s = (frames * best_s("1") - best_s(f"1-{frames}")) / (frames - 1)
    print(f"overhead of a task: {task_s:.2f} processor seconds, with {frames} frames {task_s / frames:.2f} per frame",
          flush=True)
    clock_s = []
    for workers in (1, 2):
        with cluster(work, workers) as address:
            begin_s = time.monotonic()
            render(f"workers{workers}", "--scheduler", address)
            clock_s.append(time.monotonic() - begin_s)
    print("wall-clock time with 1 worker: {:.1f} s, with 2 workers: {:.1f} s".format(*clock_s), end="")
    print(f", {clock_s[0] / clock_s[1]:.2f} times as fast; load {os.getloadavg()[1]:.1f} on {os.cpu_count()} cores")


def processor_s(work):
    """Processor seconds of all child processes that end during a call of `work`."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    work()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def run(command):
    subprocess.run([*map(str, command)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                   stdin=subprocess.DEVNULL)


@contextmanager
def cluster(work, workers):
    """Start a cluster with this number of workers, on a core each, and yield its address."""
    scheduler_file = work / "scheduler.json"
    scheduler_file.unlink(missing_ok=True)
    processes = [dask(work, "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", scheduler_file)]
    try:
        while not (scheduler_file.is_file() and scheduler_file.read_text().endswith("}")):
            time.sleep(0.1)
        for core in range(workers):
            processes.append(dask(work, "worker", "--scheduler-file", scheduler_file, "--nthreads", "1", "--no-nanny",
                                  core=core % os.cpu_count()))
        time.sleep(8.0)
        yield json.loads(scheduler_file.read_text())["address"]
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()


def dask(work, *words, core=None):
    return subprocess.Popen([sys.executable, "-m", "dask", *map(str, words), "--no-dashboard"], cwd=work,
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                            preexec_fn=(lambda: os.sched_setaffinity(0, {core})) if core is not None else None)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
