"""Complete commands: their start, memory and farms."""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from cases import ROOT, SCENE
from timing import LENSFIELD, children_s, machine, without_cache

from lensfield.engine import SpectralImage
from lensfield.engine.pictures.spectral_exr import write_exr, write_rgb_exr
from lensfield.engine.runtime.memory import available_bytes

PROGRAMS = {
    "Python": "pass",
    "numpy": "import numpy",
    "lensfield --version": "import lensfield.cli; lensfield.cli.main(['--version'])",
    "lensfield render --help": "import lensfield.cli; lensfield.cli.main(['render', '--help'])",
    "import lensfield.engine": "import lensfield.engine",
    "all names of the engine": "from lensfield.engine import *",
    "bpy": "import bpy",
    "bpy, with the extension registered": "import bpy, lensfield; lensfield.register()",
}

WITH_PEAK = [sys.executable, "-c", """
import os, sys
from lensfield.cli import main
status = main(sys.argv[1:])
with open("/proc/self/status") as status_file, open("peak", "w") as peak:
    peak.write(next(line.split()[1] for line in status_file if line.startswith("VmHWM:")))
sys.stdout.flush()
os._exit(status)"""]
"""The command, which also writes its peak memory in kB: a parent process would get a figure that includes its own."""
LENS = ["--lens", "edmund-54852"]
RENDER = ["render", str(SCENE), *LENS, "--samples", "1", "--tier", "preview"]
MEGABYTE, MOST = 1e6, 1.3

LARGE = ["filter", "in.exr", *LENS, "--azimuths", "4", "--psf-energy", "0.9", "--output", "out.exr", "--report",
         "report.json"]
LOOK_S = 0.1

STARTS, BEST_OF = 5, 3

TESTS = [ROOT / "tests" / folder for folder in ("support", "addon", "reliability")]
SAVE = "import sys; sys.path[:0] = sys.argv[2:]; from kill import save_scene; from lensfield import addon; " \
       "addon.register(); save_scene(sys.argv[1], 64); import os; os._exit(0)"

SIZES = (128, 72), (256, 144)
FILM_PX, FRAMES, WAVELENGTHS, PASSES = 3840 * 2160, 10_000, "400:700:31", 4  # passes of tier standard
PASS_BYTES = 20  # per pixel (docs/guide/scripts.md)
GIGA, TERA, HOUR_S, DAY_S = 1e9, 1e12, 3600.0, 86400.0


def start() -> Iterator[str]:
    """Processor seconds that programs take to start, in separate processes: the least of several."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    for name, code in PROGRAMS.items():
        command = [sys.executable, "-c", code + "\nimport os, sys; sys.stdout.flush(); os._exit(0)"]
        seconds = [children_s(lambda command=command: subprocess.run(command, check=True, stdout=subprocess.DEVNULL,
                                                                     env=environment)) for _ in range(STARTS)]
        yield f"{name:<36}{min(seconds):6.2f} s"


def memory() -> Iterator[str]:
    """Compare the peak memory of complete commands with their plans.

    Filters and renders some pictures, each in a separate process: the prediction of the report, the peak that the
    system (Linux) measured, and their ratio.
    """
    without_cache()
    yield f"{machine()}\n\n{'case':<42}{'predicted':>9}{'used':>9}{'ratio':>11}"
    for name, (picture, more) in COMMANDS.items():
        with tempfile.TemporaryDirectory() as folder:
            predicted, used = measured(picture, more, Path(folder))
        ratio = used / predicted
        missed = "" if 1 / MOST <= ratio <= MOST else " !"
        yield f"{name:<42}{predicted:>6.0f} MB{used:>6.0f} MB{ratio:>11.2f}{missed}"


def noisy(width, height, wavelengths):
    """A spectral picture of noise, on a sensor 4 mm wide."""
    plane = np.random.default_rng(0).random((1, height, width), np.float32)
    cube = np.broadcast_to(plane, (wavelengths, height, width))
    return SpectralImage(cube, np.linspace(420, 680, wavelengths), pitch_um=4000 / width)


COMMANDS = {
    "filter 960 x 540, 31 wavelengths": ((960, 540, 31), []),
    "filter 1920 x 1080, 7": ((1920, 1080, 7), []),
    "filter 1920 x 1080, 7, and a preview": ((1920, 1080, 7), ["--preview", "o.png"]),
    "filter 1920 x 1080, 31": ((1920, 1080, 31), []),
    "filter 3840 x 2160, 3, and a preview": ((3840, 2160, 3), ["--preview", "o.png"]),
    "filter 1920 x 1080, 3, to 0.1 %": ((1920, 1080, 3), ["--accuracy", "0.001"]),
    "filter 960 x 540, 3, each pixel 2 x 2": ((960, 540, 3), ["--supersampling", "2"]),
    "filter 1920 x 1080 in RGB, 31": (None, ["--wavelengths", "420:680:31"]),
    "render 480 x 270, 3": ((), ["--wavelengths", "450:650:3", "--resolution", "480x270"]),
    "render 1280 x 720, 21, without depth": (
        (), ["--wavelengths", "450:650:21", "--resolution", "1280x720", "--depth", "off"]),
    "render 1280 x 720, 21": ((), ["--wavelengths", "450:650:21", "--resolution", "1280x720"]),
    "render 1920 x 1080, 12, standard": (
        (), ["--wavelengths", "450:650:12", "--resolution", "1920x1080", "--tier", "standard"]),
}


def measured(picture, more, folder):
    """The peak memory of a command in MB: predicted, and measured."""
    if picture == ():
        command = [*RENDER, *more, "--output", "out"]
    else:
        if picture is None:
            write_rgb_exr(np.random.default_rng(0).random((1080, 1920, 3), np.float32), folder / "in.exr")
        else:
            write_exr(noisy(*picture), folder / "in.exr")
        command = ["filter", "in.exr", *LENS, *more, "--output", "o.exr"]
    subprocess.run([*WITH_PEAK, *command, "--report", "report.json"], cwd=folder, check=True, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL)
    report = json.loads((folder / "report.json").read_text())
    predicted = max(report["plan"]["peak_mb"], report.get("capture_peak_mb", 0))
    return predicted, int((folder / "peak").read_text()) * 1024 / MEGABYTE


def large(size=(7680, 4320, 31)) -> Iterator[str]:
    """Filter a picture that is larger than the free memory.

    Under `systemd-run --scope -p MemoryMax=4G`, noise of 7680 x 4320 px at 31 wavelengths is filtered in the current
    folder, which takes 17 GB of disk space temporarily. Prints the seconds, the memory that the report predicts, and
    the process's peak memory (Linux) without pages of files, which the system reclaims when necessary.
    """
    without_cache()
    width, height, wavelengths = size
    yield f"{machine()}, {available_bytes() / 1e9:.2f} GB free"
    with tempfile.TemporaryDirectory(dir=".") as folder:
        write_exr(noisy(width, height, wavelengths), Path(folder, "in.exr"))
        begin = time.perf_counter()
        peak_bytes = peak_anonymous_bytes(subprocess.Popen([*LENSFIELD, *LARGE], cwd=folder))
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        predicted_mb = json.loads(Path(folder, "report.json").read_text())["plan"]["peak_mb"]
    yield (f"{width} x {height}, {wavelengths} wavelengths, {4e-9 * width * height * wavelengths:.2f} GB: "
           f"{time.perf_counter() - begin:.0f} s, {used.ru_utime + used.ru_stime:.0f} processor s, "
           f"predicted {predicted_mb:.0f} MB, peak {peak_bytes / 1e6:.0f} MB")


def peak_anonymous_bytes(process):
    """Peak memory of a process without pages of files; raise an error if the process fails."""
    most = 0
    while process.poll() is None:
        lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
        most = max([most, *(1024 * int(line.split()[1]) for line in lines if line.startswith("RssAnon:"))])
        time.sleep(LOOK_S)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, process.args)
    return most


def farm(frames: int = 4) -> Iterator[str]:
    """The overhead of farms, and the gain from a second worker.

    In an environment with distributed (make test-farm creates one). The overhead of a task is the difference in
    processor seconds between one task per frame and one task for all frames, each the best of several runs. Scaling is
    measured in wall-clock time, with one and then two workers on a core each, so it is meaningless on a busy machine.
    """
    os.environ["LENSFIELD_CACHE"] = tempfile.mkdtemp(prefix="lensfield-figures-")
    work = Path(tempfile.mkdtemp(prefix="lensfield-farm-"))
    blend = work / "scene.blend"
    run([sys.executable, "-c", SAVE, blend, *TESTS])
    options = ["--frames", f"1-{frames}", "--lens-quality", "preview"]

    def render(name, *more):
        run([*LENSFIELD, "render", blend, *options, "--output", work / name, *more])

    render("bakes")

    def best_s(text):
        return min(children_s(lambda: render("alone", "--overwrite", "--frames", text)) for _ in range(BEST_OF))

    task_s = (frames * best_s("1") - best_s(f"1-{frames}")) / (frames - 1)
    yield f"overhead of a task: {task_s:.2f} processor seconds, with {frames} frames {task_s / frames:.2f} per frame"
    clock_s = []
    for workers in (1, 2):
        with cluster(work, workers) as address:
            begin_s = time.monotonic()
            render(f"workers{workers}", "--scheduler", address)
            clock_s.append(time.monotonic() - begin_s)
    yield ("wall-clock time with 1 worker: {:.1f} s, with 2 workers: {:.1f} s".format(*clock_s)
           + f", {clock_s[0] / clock_s[1]:.2f} times as fast; load {os.getloadavg()[1]:.1f} on {os.cpu_count()} cores")


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


def film(slabs: float = 4.0, machines: float = 100.0, cores: float = 32.0, dollars: float = 0.04) -> Iterator[str]:
    """Estimate a film on a farm, 10,000 frames of 31 wavelengths at 4K, from two small renders of the sample scene.

    Bytes and processor seconds per pixel come from the difference between a larger and a smaller render, which
    eliminates the constant overhead. Both renders are too coarse to need slabs of depth. `lensfield lint` reports the
    number of slabs at 4K; radiance, passes and Cycles's time are multiplied by it, which is an upper limit. A core
    costs `dollars` an hour.
    """
    with tempfile.TemporaryDirectory() as folder:
        rendered(Path(folder) / "bakes", SIZES[0])
        small, large = (rendered(Path(folder) / f"{size[0]}", size) for size in SIZES)
    more_px = SIZES[1][0] * SIZES[1][1] - SIZES[0][0] * SIZES[0][1]
    film = {name: (large[name] - small[name]) / more_px * FILM_PX for name in large}
    film["radiance.exr"] *= slabs
    seconds = film.pop("cycles_s") * slabs + film.pop("lens_s")
    for name, size in sorted(film.items(), key=lambda each: -each[1]):
        if size >= GIGA / 100:
            yield f"{name:<16}{size / GIGA:8.2f} GB per frame{size * FRAMES / TERA:8.1f} TB in total"
    total, passes = sum(film.values()), PASSES * slabs * PASS_BYTES * FILM_PX
    yield f"{'all':<16}{total / GIGA:8.2f} GB per frame{total * FRAMES / TERA:8.1f} TB in total"
    yield f"passes of a frame in progress: {passes / GIGA:.2f} GB; {passes * machines / TERA:.2f} TB on all machines"
    hours, frame_s = seconds * FRAMES / HOUR_S, seconds / cores
    yield (f"{seconds / HOUR_S:.2f} core hours per frame, {hours:,.0f} in total: ${hours * dollars:,.0f} at "
           f"${dollars} each")
    written = machines * (total + passes) / frame_s
    yield (f"{machines:g} machines of {cores:g} cores: {frame_s / 60:.1f} min per frame, "
           f"{frame_s * FRAMES / machines / DAY_S:.1f} days, {written / GIGA:.2f} GB/s written")


def rendered(folder, size):
    """Render the sample scene; returns bytes by kind of file, and the processor seconds of Cycles and of the rest."""
    seconds = children_s(lambda: run([
        *LENSFIELD, "render", SCENE, "--frames", "1", "--wavelengths", WAVELENGTHS, "--tier", "standard",
        "--resolution", "{}x{}".format(*size), "--output", folder]))
    record, = folder.glob("*_0001_report.json")
    stages = json.loads(record.read_text())["stages_s"]
    share = stages["multispectral render"] / sum(stages.values())  # of wall-clock time
    sizes = {path.name.partition("_0001_")[2]: path.stat().st_size for path in folder.glob("*_0001_*")}
    return sizes | {"cycles_s": seconds * share, "lens_s": seconds * (1 - share)}
