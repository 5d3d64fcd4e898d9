"""Complete jobs on each device of this machine: the CPU, and the GPUs that Cycles offers."""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from captures import rendered
from cases import SCENE
from jobs import PLAIN, opened
from timing import machine

from lensfield import addon
from lensfield.addon.scene.devices import CPU, devices_present, use_device
from lensfield.addon.scene.undo import Journal
from lensfield.commands.terminal import quiet

LAYERED, APPLY, TURNED = "standard in layers", "apply", "turned ring"
RENDERS = {"preview": ("PREVIEW", "off"), "standard": ("STANDARD", "off"), LAYERED: ("STANDARD", "auto"),
           "reference": ("REFERENCE", "off")}  # tier and depth
NAMES = PLAIN, *RENDERS, APPLY, TURNED
OTHER_LENS, F_NUMBER = "nikkor-28mm", 8.0
"""Of the jobs without Cycles; the f-number is one larger in each round, so that its lens is baked."""
OF_CYCLES = "create", "reset", "sync", "render", "free"
COLUMNS = {"wall_s": "wall s", "cpu_s": "cpu s", "outside_wall_s": "outside", "outside_cpu_s": "cpu s",
           "renders": "renders", "first_s": "first s", "times_wall": "x wall", "times_cpu": "x cpu"}
HEADINGS = {"wall_s": "seconds", "cpu_s": "processor", "outside_wall_s": "outside Cycles", "outside_cpu_s": "processor",
            "renders": "renders", "first_s": "first time", "times_wall": "multiple", "times_cpu": "processor"}


def device(devices=(), *, size: str = "768x576", samples: int = 64, lens: str = "edmund-54852", rounds: int = 2,
           output: str = "build/device", jobs: tuple[str, ...] = (), one: str = "") -> Iterator[str]:
    """Complete jobs on each device: plain render, tiers, layers of depth, another lens and another f-stop on these.

    Devices are cpu, optix, cuda, hip, metal and oneapi; by default the CPU and all GPUs that Cycles finds. Each has a
    process, with an empty cache, in which each job runs several times. The first time bakes lenses and prepares the
    device, and is listed in wall-clock seconds alone; the other figures are those of the last. `outside` are wall-clock
    and processor seconds outside Cycles, and `x` multiples of the plain render. After each job, the figures are written
    to FILE.json and FILE.md for --output FILE. --jobs selects some; the first is always a plain render. `one` is the
    device of a process, which prints a line of JSON for each job.

    For a try without a GPU: figures.py device cpu --size 192x144 --samples 4
    """
    if one:
        yield from map(json.dumps, _jobs(one, size, samples, lens, rounds, jobs))
        os._exit(0)  # some of Blender's wheels crash while the interpreter exits
    present = [CPU, *devices_present()]
    if unknown := {*devices}.difference(present) | {*jobs}.difference(NAMES):
        sys.exit(f"{', '.join(unknown)}: expected devices among {', '.join(present)}; jobs among {', '.join(NAMES)}")
    facts = {"machine": machine(), "scene": SCENE.name, "size": size, "samples": samples, "lens": lens, "devices": {}}
    yield f"{facts['machine']}\n{SCENE.name}, {size} px, {samples} samples, {lens}; devices: {', '.join(present)}"
    for name in devices or present:
        yield f"\n{name}\n{'':<19}" + "".join(f"{title:>9}" for title in COLUMNS.values())
        try:
            for job in _in_process(name):
                label, figures = job.pop("job"), facts["devices"].setdefault(job.pop("device"), {})
                figures[label] = job
                job |= {f"times_{kind}": job[f"{kind}_s"] / figures[PLAIN][f"{kind}_s"] for kind in ("wall", "cpu")}
                _write(facts, Path(output))
                yield f"{label:<19}" + "".join(f"{job[column]:9.2f}" for column in COLUMNS)
        except subprocess.CalledProcessError as error:  # its words are on standard error
            yield f"stopped with exit status {error.returncode}"
    yield f"\n{output}.md, {output}.json"


def _in_process(name):
    """The figures of each job on a device, from a process with an empty cache; a job at a time."""
    with tempfile.TemporaryDirectory() as cache:
        child = subprocess.Popen([sys.executable, "-W", "ignore", *sys.argv, "--one", name], stdout=subprocess.PIPE,
                                 text=True, env=os.environ | {"LENSFIELD_CACHE": cache})
        for line in child.stdout:
            if line.startswith("{"):
                yield json.loads(line)
        if child.wait():
            raise subprocess.CalledProcessError(child.returncode, child.args)


def _jobs(kind, size, samples, lens, rounds, chosen):
    """The figures of each job on a kind of device: generator of dict."""
    addon.register()
    inside, device_name = _measured_cycles(), ", ".join([kind.upper(), *devices_present().get(kind, ())])
    with tempfile.TemporaryDirectory() as folder:
        jobs = _Jobs(kind, opened(str(SCENE), size, samples), lens, Path(folder))
        for name in NAMES:
            if name in (PLAIN, *chosen) or not chosen:
                yield {"job": name, "device": device_name} | _figures(partial(jobs.run, name), rounds, inside)


class _Jobs:
    """The jobs of a scene on a kind of device, with files in a folder."""

    def __init__(self, kind, scene, lens, folder):
        self._kind, self._scene, self._lens, self._folder, self._layered = kind, scene, lens, folder, None
        scene.view_layers[0].samples, scene.render.filepath = 0, str(folder / "plain.png")

    def run(self, name, number):
        """Run a job for the time of this number, from 0."""
        if name == PLAIN:
            with Journal() as journal:
                use_device(self._scene, self._kind, journal)
                rendered(self._scene)
        elif name == APPLY:
            self._applied(lens=OTHER_LENS)
        elif name == TURNED:
            self._applied(lens=self._lens, f_number=F_NUMBER + number)
        else:
            self._through_lens(name)

    def _through_lens(self, name):
        self._scene.lensfield.tier, depth = RENDERS[name]
        return addon.render_through_lens(self._scene, lens=self._lens, depth=depth, device=self._kind, overwrite=True,
                                         output_folder=self._folder / name)

    def _applied(self, **given):
        self._layered = self._layered or self._through_lens(LAYERED).radiance
        addon.apply_lens(self._layered, output_folder=self._folder / "applied", **given)


def _figures(job, rounds, inside):
    """The figures of a job's last round, and the seconds of its first."""
    first_s = None
    for number in range(rounds):
        inside.clear()
        begin_s, begin_cpu_s = time.monotonic(), _cpu_s()
        with quiet(1):
            job(number)
        wall_s, cpu_s = time.monotonic() - begin_s, _cpu_s() - begin_cpu_s
        first_s = first_s or wall_s
    return {"first_s": first_s, "wall_s": wall_s, "cpu_s": cpu_s, "renders": inside["render"],
            "outside_wall_s": wall_s - inside["wall_s"], "outside_cpu_s": cpu_s - inside["cpu_s"]}


def _measured_cycles():
    """A Counter of seconds within Cycles, and of the calls of its functions, from now on."""
    import _cycles  # only available within Blender

    inside = Counter()

    def measured(name, function):
        def call(*arguments, **named):
            begin_s, begin_cpu_s = time.monotonic(), _cpu_s()
            try:
                return function(*arguments, **named)
            finally:
                inside.update({name: 1, "wall_s": time.monotonic() - begin_s, "cpu_s": _cpu_s() - begin_cpu_s})

        setattr(_cycles, name, call)

    for name in OF_CYCLES:
        measured(name, getattr(_cycles, name))
    return inside


def _cpu_s():
    """Processor seconds of all threads of this process, and of its children that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _write(facts, path):
    """Write the figures as JSON, and as a table for each device."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.with_suffix(".json").write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    tables = [f"{facts['scene']}, {facts['size'].replace('x', ' × ')} px, {facts['samples']} samples, {facts['lens']}; "
              f"{facts['machine']}. Seconds; multiples of the plain render."]
    for name, figures in facts["devices"].items():
        rows = ["| | " + " | ".join(HEADINGS.values()) + " |", "|---" * (len(HEADINGS) + 1) + "|"]
        for job, values in figures.items():
            rows.append(f"| {job} | " + " | ".join(f"{values[column]:.3g}" for column in HEADINGS) + " |")
        tables.append(f"**{name}**\n\n" + "\n".join(rows))
    path.with_suffix(".md").write_text("\n\n".join(tables) + "\n", encoding="utf-8")
