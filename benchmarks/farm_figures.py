"""What farms cost beyond the rendering, and what a second worker brings.

    python benchmarks/farm_figures.py [FRAMES]

in an environment that has distributed (make test-farm makes one). What a task costs is what tasks of a frame each take
beyond one of all frames, in processor seconds: the best of several. Scaling is by the clock, of workers that have a
core each, first one and then two of them: on a machine with other work to do it says little.
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
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "addon"), str(ROOT / "tests" / "reliability")]
LENSFIELD = [sys.executable, "-c", "from lensfield.cli import console; console()"]
SAVE = "import sys; sys.path[:0] = sys.argv[2:]; from kill import save_scene; from lensfield import addon; " \
       "addon.register(); save_scene(sys.argv[1], 64); import os; os._exit(0)"
BEST_OF = 3


def main(frames=4):
    os.environ["LENSFIELD_CACHE"] = tempfile.mkdtemp(prefix="lensfield-figures-")
    work = Path(tempfile.mkdtemp(prefix="lensfield-farm-"))
    blend = work / "scene.blend"
    run([sys.executable, "-c", SAVE, blend, *sys.path[:3]])
    asked = ["--frames", f"1-{frames}", "--lens-quality", "preview"]

    def render(name, *more):
        return run([*LENSFIELD, "render", blend, *asked, "--output", work / name, *more])

    render("bakes")

    def best_s(text):
        return min(processor_s(lambda: render("alone", "--overwrite", "--frames", text)) for _ in range(BEST_OF))

    task_s = (frames * best_s("1") - best_s(f"1-{frames}")) / (frames - 1)
    print(f"a task beyond its frames: {task_s:.2f} processor seconds, of {frames} frames {task_s / frames:.2f} a frame",
          flush=True)
    clock_s = []
    for workers in (1, 2):
        with cluster(work, workers) as address:
            begin_s = time.monotonic()
            render(f"workers{workers}", "--scheduler", address)
            clock_s.append(time.monotonic() - begin_s)
    print("1 worker: {:.1f} s, 2 workers: {:.1f} s by the clock".format(*clock_s), end="")
    print(f", {clock_s[0] / clock_s[1]:.2f} times as quick; load {os.getloadavg()[1]:.1f} on {os.cpu_count()} cores")


def processor_s(work):
    """Processor seconds of all processes that have ended meanwhile."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    work()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def run(command):
    subprocess.run([*map(str, command)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                   stdin=subprocess.DEVNULL)


@contextmanager
def cluster(work, workers):
    """The address of a cluster with so many workers, a core each."""
    told = work / "scheduler.json"
    told.unlink(missing_ok=True)
    processes = [dask(work, "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", told)]
    try:
        while not (told.is_file() and told.read_text().endswith("}")):
            time.sleep(0.1)
        for core in range(workers):
            processes.append(dask(work, "worker", "--scheduler-file", told, "--nthreads", "1", "--no-nanny",
                                  core=core % os.cpu_count()))
        time.sleep(8.0)
        yield json.loads(told.read_text())["address"]
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
