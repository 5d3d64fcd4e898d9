"""What the engine takes, side by side: this tree, the engine before it had loops in C, and the paper's method.

    python benchmarks/bench.py FOLDER

prints a line for each case of cases.py as it comes, and how near the worst points come to the bound, in ten minutes; it
leaves all of that in FOLDER/figures.txt. LENSFIELD_KERNELS=numpy (or base, avx2, …) says what is to run the loops.
"""

import io
import json
import os
import subprocess
import sys
import tarfile
from pathlib import Path
from typing import TextIO

import numpy as np
from cases import BOARDS, LENSES, OTHERS, PAPER, PAPER_LENS, checkerboard, points
from point_images import point_images
from scipy.signal import fftconvolve
from timing import least_s, machine, quickest
from worst_points import table_lines

from lensfield.engine import Lens, Options, simulate
from lensfield.engine.plan.choose import make_plan
from lensfield.engine.trade.tradeoff import errors

HERE = Path(__file__).resolve().parent
BEFORE = "ac0321c"  # the last engine with numpy's loops alone
WIDTHS = {"case": 39, "asked": 7, "now": 9, "before": 9, "paper": 8, "before/now": 11, "waited": 8, "told": 7,
          "again": 7, "bound": 9, "L2": 9, "MB": 7, "over floor": 12, "  plan": 0}
AS_FILE = "1920x1080 x 12, 0.01, nikkor-28mm"
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1"}  # for matrices; the engine has its own
LEFT = "case", "  plan"
MOST = {"told": 1.3, "again": 0.4, "MB": 1500, "over floor": 2.0}
LEGEND = f"""\
asked, now, before, paper  seconds of the processor, of all threads, cold: a lens fresh from its data, its plan and PSFs
                           included; no files. before: {BEFORE}; ~: some wavelengths stand for all
waited, told               seconds on the clock; what the plan told over these, or these over that: {MOST["told"]} asked
again                      the second frame over the first, with what that has kept: {MOST["again"]} asked
bound, L2                  of any point's light misplaced, promised; of a grid of points, against the exact operator
MB                         of the process at most, the picture included: {MOST["MB"]} asked of the largest
over floor                 now, over the plan's multiply-adds alone (point_images.py counts them), at the rate of
                           numpy's products of a matrix in the cache and a vector, which like these take a value from
                           there for each; {MOST["over floor"]:g} asked
!                          missed"""


class Table:
    """Lines, printed and filed as they come."""

    def __init__(self, file: TextIO) -> None:
        self._file = file

    def tell(self, text: str = "") -> None:
        for file in (sys.stdout, self._file):
            print(text.rstrip(), file=file, flush=True)

    def row(self, cells: dict[str, str]) -> None:
        self.tell("".join(f"{cells.get(name, ''):<{width}}" if name in LEFT else f"{cells.get(name, ''):>{width}}"
                          for name, width in WIDTHS.items()))


def engine_before(folder):
    """Where the earlier engine can be imported from; None where the history does not hold it."""
    archive = subprocess.run(["git", "-C", HERE.parent, "archive", BEFORE, "__init__.py", "engine"],
                             capture_output=True)
    if archive.returncode:
        return None
    with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as files:
        files.extractall(folder / "before" / "lensfield", filter="data")
    return folder / "before"


def measured(case, options, python_path=None, **how):
    """What measure_case.py prints, of the engine that is found at `python_path`; else of this tree's."""
    task = {"name": case.name, "options": options, "best_of": case.best_of} | how
    return answer("measure_case.py", task, python_path)


def answer(script, task, python_path=None):
    """What a script prints of a task, in a process of its own."""
    environment = os.environ | ONE_THREAD | ({"PYTHONPATH": str(python_path)} if python_path else {})
    printed = subprocess.run([sys.executable, HERE / script, json.dumps(task)], env=environment, check=True,
                             stdout=subprocess.PIPE).stdout
    facts = json.loads(printed)
    expected = python_path / "lensfield" if python_path else HERE.parent
    if not Path(facts["engine"]).parent.samefile(expected):
        sys.exit(f"the engine of {facts['engine']} was measured, and not that of {expected}")
    return facts


def slow_s(case, options, python_path=None):
    """Processor seconds of a way of which some of the wavelengths may have to stand for all."""
    if not case.part:
        return measured(case, options, python_path)["processor_s"]
    facts = measured(case, options, python_path, wavelengths=case.part, best_of=1)
    return facts["processor_s"] * case.wavelengths / case.part


def cells_of(case, before):
    """The cells of a case's row."""
    about, asked_s = "~" if case.part else "", case.asked_s
    now = measured(case, {"accuracy": case.accuracy}, frames=1 if case.in_place else 2, floor=True)
    told = now["predicted_s"] / now["waited_s"]
    cells = {"case": case.name, "waited": f"{now['waited_s']:.2f}", "told": judged("told", max(told, 1 / told), ".2f"),
             "bound": f"{now['bound']:.1e}", "MB": f"{now['peak_mb']:.0f} ", "  plan": f"  {now['way']}"}
    if before:
        then_s = slow_s(case, {"accuracy": case.accuracy}, before)
        asked_s = asked_s or then_s / 2
        cells |= {"before": f"{about}{then_s:.2f}", "before/now": f"{then_s / now['processor_s']:.1f}"}
    if asked_s:
        cells["asked"] = f"{asked_s:.2f}"
    cells["now"] = marked(f"{now['processor_s']:.3f}", asked_s and now["processor_s"] > asked_s)
    if case.in_place:
        cells["MB"] = judged("MB", now["peak_mb"], ".0f")
    else:  # where the paper's method would not take minutes for a wavelength
        cells["paper"] = f"{about}{slow_s(case, {'method': 'paper'}):.2f}"
        cells["again"] = judged("again", now["later_s"] / now["processor_s"], ".2f")
    if "floor_s" in now:
        cells["over floor"] = judged("over floor", now["processor_s"] / now["floor_s"], ".1f")
    return cells


def judged(column, value, form):
    return marked(f"{value:{form}}", value > MOST[column])


def marked(text, missed):
    return f"{text}{'!' if missed else ' '}"


def file_lines(before):
    """What a case's radiance takes as a file."""
    yield f"the radiance of {AS_FILE} as EXR: seconds of the processor and on the clock"
    for name, python_path in {"now": None, "before": before}.items():
        if python_path or name == "now":
            facts = answer("measure_files.py", {"name": AS_FILE}, python_path)
            yield "{:<8} written {:.2f} {:.2f}, read {:.2f} {:.2f}; {:.0f} MB".format(
                name, *facts["written"], *facts["read"], facts["size_mb"])


def relative_l2(cube, exact):
    return f"{errors(cube, exact)['relative_l2']:.1e}"


def boards(table, before):
    """The paper's frame, at one wavelength: by accuracy, by the paper's method, and by one PSF, that of the axis."""
    lens, dots = Lens.load(PAPER_LENS), points()
    exact = simulate(dots, lens, Options(method="exact")).cube
    for case in BOARDS:
        result = simulate(dots, lens, Options(accuracy=case.accuracy)).cube
        table.row(cells_of(case, before) | {"L2": relative_l2(result, exact)})
    paper_s = quickest(checkerboard(), lens, PAPER).processor_s
    table.row({"case": "768x576, the paper's method", "now": f"{paper_s:.3f} ",
               "L2": relative_l2(simulate(dots, lens, PAPER).cube, exact)})
    seconds, result = one_psf(dots, lens)
    table.row({"case": "768x576, one PSF by scipy", "now": f"{seconds:.3f} ", "L2": relative_l2(result[None], exact)})


def one_psf(radiance, lens):
    """The wrong picture, of the PSF on the axis alone: processor seconds of its convolution, and the picture."""
    plan = make_plan(Options(accuracy=0.001), lens, radiance)
    (images,), middle = point_images(lens, radiance, plan), np.array(radiance.grid.shape_px)[None] // 2
    planes, psf = images.channel.planes, images.by_plan(middle)[0].astype(np.float32)
    ideal = planes.join(planes.without_doubles(images.channel.ideal_irradiance(radiance.cube[0])))
    return least_s(lambda: fftconvolve(ideal, psf, "same"), 20)[0], fftconvolve(ideal, psf, "same")


def main(folder):
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "figures.txt", "w", encoding="utf-8") as file:
        tell_all(Table(file), engine_before(folder.resolve()))


def tell_all(table, before):
    table.tell(machine())
    if not before:
        table.tell(f"no engine of before: the history does not hold {BEFORE}")
    table.tell(LEGEND)
    table.tell()
    table.row({name: name for name in WIDTHS})
    boards(table, before)
    for case in OTHERS:
        table.row(cells_of(case, before))
    for lines in (file_lines(before), table_lines(LENSES)):
        table.tell()
        for line in lines:
            table.tell(line)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
