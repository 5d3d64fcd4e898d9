"""Time and memory of the engine, compared with the paper's method.

    python benchmarks/bench.py FOLDER

prints a line for each case of cases.py as soon as it is measured, then the errors of the worst points relative to the
bound, in ten minutes. It also writes them to FOLDER/figures.txt. LENSFIELD_KERNELS=numpy (or base, avx2, …) chooses the
implementation of the loops.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import TextIO

import numpy as np
from cases import BOARDS, LENSES, NM, OTHERS, PAPER, PAPER_LENS, checkerboard, points
from overlap_add import given_psfs, overlap_add
from point_images import point_images
from scipy.signal import fftconvolve
from timing import least_s, machine, quickest
from worst_points import table_lines

from lensfield.engine import Options, load_lens, simulate
from lensfield.engine.inspection.tradeoff import errors
from lensfield.engine.plan.choose import make_plan

HERE = Path(__file__).resolve().parent
WIDTHS = {"case": 39, "target": 8, "now": 9, "paper": 8, "clock": 8, "off": 7, "again": 7, "bound": 9, "L2": 9, "MB": 7,
          "  plan": 0}
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1"}  # for matrices; the engine has its own threads
LEFT = "case", "  plan"
MOST = {"off": 1.3, "again": 0.4, "MB": 1500}
LEGEND = f"""\
target, now, paper  processor seconds of all threads, cold: a lens fresh from its data, with its plan and PSFs; no files
                    ~: measured at some wavelengths
clock, off          wall-clock seconds; the ratio of the predicted time to them, or its inverse: at most {MOST["off"]}
again               the time of a second frame with cached channels, relative to the first: at most {MOST["again"]}
bound, L2           the largest fraction of a point's light that may be misplaced; the error of a grid of points
MB                  peak memory of the process with the picture: for the largest at most {MOST["MB"]}
!                   missed"""


class Table:
    """A table whose lines are printed and written to a file immediately."""

    def __init__(self, file: TextIO) -> None:
        self._file = file

    def write(self, text: str = "") -> None:
        for file in (sys.stdout, self._file):
            print(text.rstrip(), file=file, flush=True)

    def row(self, cells: dict[str, str]) -> None:
        self.write("".join(f"{cells.get(name, ''):<{width}}" if name in LEFT else f"{cells.get(name, ''):>{width}}"
                          for name, width in WIDTHS.items()))


def measured(case, options, **how):
    """The figures that measure_case.py prints, run in a separate process."""
    task = {"name": case.name, "options": options, "best_of": case.best_of} | how
    printed = subprocess.run([sys.executable, HERE / "measure_case.py", json.dumps(task)], env=os.environ | ONE_THREAD,
                             check=True, stdout=subprocess.PIPE).stdout
    return json.loads(printed)


def paper_s(case):
    """Processor seconds of the paper's method, extrapolated from `case.part` of the wavelengths if this is set."""
    if not case.part:
        return measured(case, {"method": "paper"})["processor_s"]
    facts = measured(case, {"method": "paper"}, wavelengths=case.part, best_of=1)
    return facts["processor_s"] * case.wavelengths / case.part


def cells_of(case):
    """The cells of a case's row."""
    now = measured(case, {"accuracy": case.accuracy}, frames=1 if case.in_place else 2)
    ratio = now["predicted_s"] / now["waited_s"]
    cells = {"case": case.name, "target": f"{case.target_s:g}" if case.target_s else "",
             "now": marked(f"{now['processor_s']:.3f}", case.target_s and now["processor_s"] > case.target_s),
             "clock": f"{now['waited_s']:.2f}", "off": judged("off", max(ratio, 1 / ratio), ".2f"),
             "bound": f"{now['bound']:.1e}", "MB": f"{now['peak_mb']:.0f} ", "  plan": f"  {now['way']}"}
    if case.in_place:
        cells["MB"] = judged("MB", now["peak_mb"], ".0f")
    else:  # for the largest picture, the paper's method takes minutes per wavelength
        cells["paper"] = f"{'~' if case.part else ''}{paper_s(case):.2f}"
        cells["again"] = judged("again", now["later_s"] / now["processor_s"], ".2f")
    return cells


def judged(column, value, form):
    return marked(f"{value:{form}}", value > MOST[column])


def marked(text, missed):
    return f"{text}{'!' if missed else ' '}"


def relative_l2(cube, exact):
    return f"{errors(cube, exact)['relative_l2']:.1e}"


def boards(table):
    """The paper's frame, at one wavelength: for each accuracy, by the paper's method, and by the on-axis PSF alone."""
    lens, dots = load_lens(PAPER_LENS), points()
    exact = simulate(dots, lens, Options(method="exact")).cube
    for case in BOARDS:
        result = simulate(dots, lens, Options(accuracy=case.accuracy)).cube
        table.row(cells_of(case) | {"L2": relative_l2(result, exact)})
    seconds = quickest(checkerboard(), lens, PAPER).processor_s
    table.row({"case": "768x576, the paper's method", "now": f"{seconds:.3f} ",
               "L2": relative_l2(simulate(dots, lens, PAPER).cube, exact)})
    seconds, result = one_psf(dots, lens)
    table.row({"case": "768x576, one PSF by scipy", "now": f"{seconds:.3f} ", "L2": relative_l2(result[None], exact)})
    with_given_psfs(table, dots, lens, exact)


def with_given_psfs(table, dots, lens, exact):
    """The filter without planning and PSFs: hat windows, and the engine's second frame, which must be twice as fast at
    a tenth of the error."""
    options = Options(accuracy=0.01)
    hats_s, hats = hat_windows(dots, lens)
    engine_s = quickest(checkerboard(), lens, options, 10, frames=2).later_s
    engine = simulate(dots, lens, options).cube
    hats_l2, engine_l2 = (errors(cube, exact)["relative_l2"] for cube in (hats[None], engine))
    table.row({"case": "768x576, hat windows, PSFs given", "now": f"{hats_s:.3f} ", "L2": f"{hats_l2:.1e}"})
    table.row({"case": "768x576, 0.01, PSFs given", "target": f"{hats_s / 2:.3f}",
               "now": marked(f"{engine_s:.3f}", engine_s > hats_s / 2),
               "L2": marked(f"{engine_l2:.1e}", engine_l2 > hats_l2 / 10).rstrip()})


def hat_windows(radiance, lens):
    """Convolve with the PSFs of overlapping sections; returns processor seconds and the picture."""
    plan = make_plan(Options(accuracy=0.001), lens, radiance.sampling)
    (images,) = point_images(lens, radiance, plan)
    ideal, psfs = ideal_picture(images, radiance), given_psfs(lens, NM, radiance.grid, plan.psf_energy)
    return least_s(lambda: overlap_add(ideal, psfs), 10)[0], overlap_add(ideal, psfs)


def one_psf(radiance, lens):
    """Convolve with the on-axis PSF alone, which is inaccurate; returns processor seconds and the picture."""
    plan = make_plan(Options(accuracy=0.001), lens, radiance.sampling)
    (images,), middle = point_images(lens, radiance, plan), np.array(radiance.grid.shape_px)[None] // 2
    ideal, psf = ideal_picture(images, radiance), images.by_plan(middle)[0].astype(np.float32)
    return least_s(lambda: fftconvolve(ideal, psf, "same"), 20)[0], fftconvolve(ideal, psf, "same")


def ideal_picture(images, radiance):
    """The irradiance before the blur: array (row, column)."""
    planes = images.channel.planes
    return planes.join(planes.without_doubles(images.channel.ideal_irradiance(radiance.cube[0])))


def main(folder):
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "figures.txt", "w", encoding="utf-8") as file:
        write_all(Table(file))


def write_all(table):
    table.write(machine())
    table.write(LEGEND)
    table.write()
    table.row({name: name for name in WIDTHS})
    boards(table)
    for case in OTHERS:
        table.row(cells_of(case))
    table.write()
    for line in table_lines(LENSES):
        table.write(line)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
