"""Time and memory of the engine, compared with the paper's method."""

import json
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy
from cases import BOARDS, CASES, LENSES, NM, OTHERS, PAPER, PAPER_LENS, checkerboard, points
from errors import point_images, worst_lines
from scipy.signal import fftconvolve
from timing import least_s, machine, marked, quickest, without_cache

from lensfield.engine import Lens, Options, SpectralImage, load_lens, simulate
from lensfield.engine.field.mirror_symmetry import Planes
from lensfield.engine.field.radial.distortion import FieldGeometry
from lensfield.engine.field.radial.psf_bank import PlacedPsfs, PsfBank
from lensfield.engine.image.pixel_grid import PixelGrid
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
SECTION_PX = 44  # between the middles of sections: the paper's frame has an error (L2) of 0.011


def bench(folder: str = "build/bench") -> Iterator[str]:
    """Time and memory of the engine, compared with the paper's method.

    A line for each case of cases.py, then the errors of the worst points relative to the bound, in ten minutes;
    written to FOLDER/figures.txt as well.
    """
    without_cache()
    Path(folder).mkdir(parents=True, exist_ok=True)
    with open(Path(folder) / "figures.txt", "w", encoding="utf-8") as file:
        for line in lines():
            print(line.rstrip(), file=file, flush=True)
            yield line.rstrip()


def lines():
    """The lines of `bench`."""
    yield f"{machine()}\n{LEGEND}\n"
    yield row({name: name for name in WIDTHS})
    yield from boards()
    for each in OTHERS:
        yield row(cells_of(each))
    yield ""
    yield from worst_lines(LENSES)


def row(cells: dict[str, str]) -> str:
    """A row of the table."""
    return "".join(f"{cells.get(name, ''):<{width}}" if name in LEFT else f"{cells.get(name, ''):>{width}}"
                   for name, width in WIDTHS.items())


def case(name: str = "768x576, 0.01", *, method: str = "", accuracy: float = 0.01, best_of: int = 3,
         wavelengths: int = 0, frames: int = 1) -> Iterator[str]:
    """Run one case of cases.py through the engine, and print its time and memory as a line of JSON.

    `wavelengths` limits their number. With two `frames`, the second uses the channels that the first has cached.
    """
    without_cache()
    chosen, options = CASES[name], Options(method=method) if method else Options(accuracy=accuracy)
    lens = load_lens(chosen.lens)
    radiance = chosen.radiance(lens)
    if wavelengths:
        radiance = spread_out(radiance, wavelengths)
    warm_up = SpectralImage(np.ones((16, 16)), [500], pitch_um=10)
    quickest(warm_up, load_lens(PAPER_LENS), Options())
    run = quickest(radiance, lens, options, best_of, frames, radiance.cube if chosen.in_place else None)
    plan = run.report.lens_image.plan
    yield json.dumps({"processor_s": run.processor_s, "waited_s": run.waited_s, "later_s": run.later_s,
                      "predicted_s": plan.seconds, "bound": plan.error_bound, "way": plan.method.text,
                      "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3})


def spread_out(radiance, count):
    """Reduce a picture to `count` evenly spaced wavelengths, without the first and the last."""
    some = np.linspace(0, radiance.wavelengths_nm.size - 1, count + 2).round().astype(int)[1:-1]
    return replace(radiance, cube=radiance.cube[some], wavelengths_nm=radiance.wavelengths_nm[some])


def measured(case, options, **how):
    """The figures that `case` yields, in a separate process."""
    given = {"best_of": case.best_of} | options | how
    words = [f"--{name.replace('_', '-')}={value}" for name, value in given.items()]
    printed = subprocess.run([sys.executable, HERE / "figures.py", "case", case.name, *words],
                             env=os.environ | ONE_THREAD, check=True, stdout=subprocess.PIPE).stdout
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


def relative_l2(cube, exact):
    return f"{errors(cube, exact)['relative_l2']:.1e}"


def boards():
    """Rows of the paper's frame, at one wavelength: by accuracy, by the paper's method, by the on-axis PSF alone."""
    lens, dots = load_lens(PAPER_LENS), points()
    exact = simulate(dots, lens, Options(method="exact")).cube
    for case in BOARDS:
        result = simulate(dots, lens, Options(accuracy=case.accuracy)).cube
        yield row(cells_of(case) | {"L2": relative_l2(result, exact)})
    seconds = quickest(checkerboard(), lens, PAPER).processor_s
    yield row({"case": "768x576, the paper's method", "now": f"{seconds:.3f} ",
               "L2": relative_l2(simulate(dots, lens, PAPER).cube, exact)})
    seconds, result = one_psf(dots, lens)
    yield row({"case": "768x576, one PSF by scipy", "now": f"{seconds:.3f} ", "L2": relative_l2(result[None], exact)})
    yield from with_given_psfs(dots, lens, exact)


def with_given_psfs(dots, lens, exact):
    """Rows of the filter without planning and PSFs: hat windows, and the engine's second frame, which must be twice as
    fast at a tenth of the error."""
    options = Options(accuracy=0.01)
    hats_s, hats = hat_windows(dots, lens)
    engine_s = quickest(checkerboard(), lens, options, 10, frames=2).later_s
    engine = simulate(dots, lens, options).cube
    hats_l2, engine_l2 = (errors(cube, exact)["relative_l2"] for cube in (hats[None], engine))
    yield row({"case": "768x576, hat windows, PSFs given", "now": f"{hats_s:.3f} ", "L2": f"{hats_l2:.1e}"})
    yield row({"case": "768x576, 0.01, PSFs given", "target": f"{hats_s / 2:.3f}",
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


def given_psfs(lens: Lens, wavelength_nm: float, grid: PixelGrid, energy: float) -> np.ndarray:
    """PSFs at the middles of the sections: float32 array (section row, section column, row, column)."""
    optics = lens.at_wavelength(wavelength_nm)
    bank = PsfBank.of(optics, grid.pitch_um).trimmed(energy)
    places = np.meshgrid(*(_middles(n) for n in grid.shape_px), indexing="ij")
    placed = PlacedPsfs(lambda: bank, FieldGeometry(optics, lens.name), Planes(grid, False))
    psfs = placed.psfs(*(each.ravel() for each in places))
    return psfs.reshape(*places[0].shape, *psfs.shape[1:]).astype(np.float32)


def overlap_add(picture: np.ndarray, psfs: np.ndarray) -> np.ndarray:
    """Blur a picture, (row, column), in sections that overlap by half, under windows that sum to 1, by their PSFs."""
    radius, window = psfs.shape[-1] // 2, 2 * SECTION_PX - 1
    side, margin = scipy.fft.next_fast_len(window + 2 * radius, real=True), SECTION_PX - 1
    hat = (1 - np.abs(np.arange(-margin, SECTION_PX)) / SECTION_PX).astype(picture.dtype)
    framed = np.pad(picture, (margin, 2 * SECTION_PX))
    result = np.zeros([n + side for n in framed.shape], picture.dtype)
    for psfs_of_row, top in zip(psfs, _middles(picture.shape[0]), strict=True):
        for psf, left in zip(psfs_of_row, _middles(picture.shape[1]), strict=True):
            section = framed[top:top + window, left:left + window] * hat[:, None] * hat
            spectrum = scipy.fft.rfft2(section, (side, side)) * scipy.fft.rfft2(psf, (side, side))
            result[top:top + side, left:left + side] += scipy.fft.irfft2(spectrum, (side, side))
    rows, columns = (slice(margin + radius, margin + radius + n) for n in picture.shape)
    return result[rows, columns]


def _middles(length_px):
    return np.arange(-(-length_px // SECTION_PX) + 1) * SECTION_PX
