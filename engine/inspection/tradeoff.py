"""Measure error against time and memory: every knob of the engine, the exact operator and the paper's method.

Times are of cold runs, the best of several: `simulate` without any cache, including plan, PSFs and OTFs. Memory is
measured in separate runs: the peak that Python and numpy hold in addition to the radiance, including the irradiance but
not the internal memory of the FFTs. The exact operator runs only once, for both. All of this depends on the machine, so
times are also given relative to the paper's method in the same run.
"""

import csv
import time
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..field.field_map import field_map
from ..image.spectral_image import SpectralImage
from ..lens import Lens
from ..pictures.preview import to_rec709
from ..plan.options import Options
from ..runtime.errors import ImageError
from ..runtime.files import atomic_path
from ..simulation.channel_cache import ChannelCache
from ..simulation.report import Report
from ..simulation.simulate import simulate
from ..spectral.spectra import blackbody, library_names, load_spectrum

DEFAULT_SHAPE_PX = 288, 384  # the paper's frame at twice its pitch: the exact operator takes half a minute
POINT_SPACING_PX = 23  # coprime to section sizes, so points are at all positions in sections
SQUARE_PX = 24
BAND_NM = 400.0, 700.0
WAVELENGTHS = 1, 3, 5, 9, 15, 31
TUNGSTEN_K = 2856
EXACT = "the exact operator"
AS_WRITTEN = "the paper as written"

PAPER_SECTIONS = 4, 8, 16, 32, 64
AZIMUTHS = 2, 4, 8, 16, 32, 64, 128
ACCURACIES = 0.1, 0.03, 0.01, 1e-3, 1e-4
PSF_ENERGIES = 0.9, 0.99, 0.999, 0.9999, 0.999999, 1.0
BASE: dict[str, Any] = {"section_size": 32}  # for curves of other knobs
ROUNDS = 5
EXACT_STEPS = 150  # the exact operator's time relative to the others, approximately

Pictures = dict[str, SpectralImage]
ByWavelengths = dict[str, dict[int, SpectralImage]]
"""Pictures by name and number of wavelengths."""


@dataclass(frozen=True)
class Row:
    """One measurement.

    Attributes
    ----------
    image, curve : str
        The name of the picture; the knob that varies: "paper" (its method with sections of other sizes and in single
        precision), "pixels" and "sections" (azimuths), "accuracy", "precision", "PSF support", "wavelengths"; or,
        without such a knob, "the paper as written" and "exact".
    method, section_size, azimuths, precision
        From the plan; None if they do not apply.
    psf_energy : float
        The fraction of each PSF that was used.
    accuracy : float or None
        The target accuracy.
    wavelengths : int
        Number of wavelengths.
    seconds : float
        Wall time.
    seconds_over_paper : float or None
        Its ratio to the time of the paper's method on the same picture; None without rotational symmetry, which that
        method needs.
    peak_mb : float
    relative_l2, maximum_error, l1 : float
        Errors relative to the norm, the maximum and the sum of the reference.
    predicted_bound : float or None
        The plan's bound on `l1`.
    against : str
        The reference.
    """

    image: str
    curve: str
    method: str
    section_size: int | None
    azimuths: int | None
    precision: str
    psf_energy: float
    accuracy: float | None
    wavelengths: int
    seconds: float
    seconds_over_paper: float | None
    peak_mb: float
    relative_l2: float
    maximum_error: float
    l1: float
    predicted_bound: float | None
    against: str


def point_grid(shape_px: tuple[int, int], pitch_um: float, wavelength_nm: float) -> SpectralImage:
    """Single lit pixels on a grid: the worst case, because errors of neighbours do not overlap."""
    points = np.zeros(shape_px)
    first = [min(POINT_SPACING_PX, n) // 2 for n in shape_px]
    points[first[0]::POINT_SPACING_PX, first[1]::POINT_SPACING_PX] = 1
    return SpectralImage(points, [wavelength_nm], pitch_um=pitch_um)


def checkerboard(shape_px: tuple[int, int], pitch_um: float, wavelength_nm: float) -> SpectralImage:
    """The paper's target, a checkerboard."""
    row, column = np.indices(shape_px) // SQUARE_PX
    return SpectralImage((row + column + 1) % 2, [wavelength_nm], pitch_um=pitch_um)


def colour_chart(shape_px: tuple[int, int], pitch_um: float,
                 wavelengths_nm: Sequence[float] | np.ndarray) -> SpectralImage:
    """Squares of the reflectances of a colour chart, in tungsten light."""
    charts = [load_spectrum(name).at(wavelengths_nm) for name in library_names() if name.startswith("chart-")]
    row, column = np.indices(shape_px) // SQUARE_PX
    light = blackbody(TUNGSTEN_K).at(wavelengths_nm)[:, None, None]
    return SpectralImage(light * np.stack(charts, axis=1)[:, (7 * row + column) % len(charts)], wavelengths_nm,
                         pitch_um=pitch_um)


def standard_pictures(lens: Lens, shape_px: tuple[int, int] = DEFAULT_SHAPE_PX,
                      pitch_um: float | None = None) -> tuple[Pictures, ByWavelengths]:
    """Default pictures to measure, as wide as the lens's sensor or with this pitch.

    Returns
    -------
    pictures : dict of str: SpectralImage
        At the lens's reference wavelength.
    spectral : dict of str: dict of int: SpectralImage
        A picture with spectra, by the number of its wavelengths; empty for lens data at a single wavelength.
    """
    pitch_um = pitch_um if pitch_um is not None else lens.sensor_mm[0] * 1e3 / shape_px[1]
    nm = lens.reference_wavelength_nm
    pictures = {"points": point_grid(shape_px, pitch_um, nm), "checkerboard": checkerboard(shape_px, pitch_um, nm)}
    first, last = max(BAND_NM[0], lens.wavelengths_nm[0]), min(BAND_NM[1], lens.wavelengths_nm[-1])
    if last <= first:
        return pictures, {}
    return pictures, {"colour chart": {
        count: colour_chart(shape_px, pitch_um, np.linspace(first, last, count) if count > 1 else [nm])
        for count in WAVELENGTHS}}


def thinned(name: str, radiance: SpectralImage) -> ByWavelengths:
    """A picture at some and at all of its wavelengths, for `measure`.

    Empty for a picture with a single wavelength, or without visible light.
    """
    every, chosen = radiance.wavelengths_nm.size, {}
    if every == 1 or not to_rec709(radiance).any():
        return {}
    for count in [n for n in WAVELENGTHS if n < every] + [every]:
        index = np.round(np.linspace(0, every - 1, count)).astype(int) if count > 1 else [every // 2]
        chosen[count] = replace(radiance, cube=radiance.cube[index], wavelengths_nm=radiance.wavelengths_nm[index])
    return {name: chosen}


def cropped_frame(radiance: SpectralImage, lens: Lens, shape_px: tuple[int, int]) -> SpectralImage:
    """The middle of a picture's frame, with this many rows and columns or one more, and overscan around it."""
    margin = [max(0, (n - wanted) // 2) for n, wanted in zip(radiance.frame_px, shape_px, strict=True)]
    outside = radiance.overscan_px[0] + margin[0], radiance.overscan_px[1] + margin[1]
    grid = replace(radiance.grid, overscan_px=outside)
    places = field_map(lens)
    needed = places.overscan_px(grid, radiance.wavelengths_nm, places.psf_radius_px(radiance.pitch_um))
    spare = tuple(max(0, have - want) for have, want in zip(outside, needed, strict=True))
    return replace(radiance, grid=grid).cropped(spare)


def description(lens: Lens, pictures: dict[str, SpectralImage]) -> str:
    """Lens, pixels and wavelengths, for the title of a plot."""
    radiance = next(iter(pictures.values()))
    nm, (rows, columns) = radiance.wavelengths_nm, radiance.frame_px
    light = f"{nm[0]:g} nm" if nm.size == 1 else f"{nm.size} wavelengths"
    return f"{lens.name}, {columns} × {rows} px of {radiance.pitch_um:g} µm, {light}"


def settings(lens: Lens, quick: bool = False) -> list[tuple[str, Options]]:
    """(curve, Options) of all measurements of a picture through a lens; of fewer if `quick`."""
    def some(values):
        return values[1::2] if quick else values

    if field_map(lens).rotationally_symmetric:
        methods = [(AS_WRITTEN, Options(method="paper")),
                   *(("paper", Options(method="paper", section_size=size, precision="auto"))
                     for size in some(PAPER_SECTIONS)),
                   *((method, Options(method=method, azimuths=n)) for method in ("pixels", "sections")
                     for n in some(AZIMUTHS))]
    else:
        methods = [(method, Options(method=method)) for method in ("pixels", "sections")]
    return [*methods,
            *(("accuracy", Options(accuracy=accuracy)) for accuracy in some(ACCURACIES)),
            *(("precision", Options(**BASE, precision=name)) for name in ("float32", "auto", "float64")),
            *(("PSF support", Options(**BASE, psf_energy=energy)) for energy in some(PSF_ENERGIES))]


def measure(lens: Lens, pictures: Pictures, spectral: ByWavelengths, *, quick: bool = False,
            progress: Callable[[float, str], object] | None = None) -> list[Row]:
    """Measure errors, times and memory of all settings.

    Parameters
    ----------
    lens : Lens
    pictures : dict of str: SpectralImage
        Radiance; the exact operator is applied to each.
    spectral : dict of str: dict of int: SpectralImage
        Pictures at several numbers of wavelengths. Errors are measured in linear Rec. 709, relative to the picture with
        the most wavelengths.
    quick : bool
        Fewer settings, each timed once.
    progress : callable (fraction, label), optional

    Returns
    -------
    list of Row

    Raises
    ------
    LensError, ImageError
        As `simulate`; also if a picture is black.
    """
    chosen, rounds = settings(lens, quick), 1 if quick else ROUNDS
    counts = {name: sorted(thinned, reverse=True)[::2 if quick else 1] for name, thinned in spectral.items()}
    on_progress = _progress_reporter(progress, sum(
        (EXACT_STEPS + len(chosen) * (1 + rounds)) * radiance.wavelengths_nm.size for radiance in pictures.values())
        + sum((sum(numbers) + numbers[0]) * (1 + rounds) for numbers in counts.values()))
    rows = []
    for name, radiance in pictures.items():
        rows += _against_exact(name, radiance, lens, chosen, rounds, on_progress)
    for name, numbers in counts.items():
        thinned = {count: spectral[name][count] for count in numbers}
        rows += _against_most_wavelengths(name, thinned, lens, rounds, on_progress)
    return rows


def _progress_reporter(progress, steps):
    """A function (label, number of steps) to call before each part of the work, which reports progress."""
    completed = 0

    def on_progress(label, step_count=1):
        nonlocal completed
        if progress:
            progress(min(1.0, completed / steps), label)
        completed += step_count

    return on_progress


def _against_exact(name, radiance, lens, chosen, rounds, on_progress):
    """Rows of a picture, starting with the exact operator, which runs once for both time and memory."""
    planes = radiance.wavelengths_nm.size
    on_progress(f"{name}: {EXACT} (slow)", EXACT_STEPS * planes)
    begin = time.perf_counter()
    exact, row = _traced_row(radiance, lens, Options(method="exact"))
    seconds = time.perf_counter() - begin
    if not exact.cube.any():
        raise ImageError(name, "radiance", "black", "expected a picture with light, because errors are relative")
    rows = [replace(row, image=name, curve="exact", against=EXACT)]
    for number, (curve, options) in enumerate(chosen, 1):
        on_progress(f"{name}: error and memory, {number} of {len(chosen)}", planes)
        result, row = _traced_row(radiance, lens, options)
        rows.append(replace(row, image=name, curve=curve, against=EXACT, **errors(result.cube, exact.cube)))
    work = [(radiance, lens, options) for _, options in chosen]
    return _with_times(rows, [seconds, *_best_seconds(name, work, rounds, on_progress)])


def _against_most_wavelengths(name, spectral, lens, rounds, on_progress):
    """Rows of one picture at several numbers of wavelengths, descending."""
    most = max(spectral)
    against = f"{most} wavelengths in Rec. 709"
    chosen = [("wavelengths", Options(**BASE), count) for count in spectral]
    chosen += [(AS_WRITTEN, options, most) for curve, options in settings(lens) if curve == AS_WRITTEN]
    rows, best = [], None
    for curve, options, count in chosen:
        on_progress(f"{name}: error and memory, {count} wavelengths", count)
        result, row = _traced_row(spectral[count], lens, options)
        picture = to_rec709(result)
        best = picture if best is None else best
        rows.append(replace(row, image=name, curve=curve, against=against, **errors(picture, best)))
    work = [(spectral[count], lens, options) for _, options, count in chosen]
    return _with_times(rows, _best_seconds(name, work, rounds, on_progress))


def _traced_row(radiance, lens, options):
    """Irradiance, and a Row with the plan and the peak memory."""
    report = Report()
    result, peak_mb = _traced(lambda: simulate(radiance, lens, options, report=report, cache=_nothing()))
    return result, _row_of_plan(report.lens_image.plan, options, radiance.wavelengths_nm.size, peak_mb)


def _row_of_plan(plan, options, wavelengths, peak_mb):
    """A Row of a plan, without picture, times and errors."""
    by_section = plan.precision == "float32" and plan.single_range < np.inf
    return Row(
        image="", curve="", method=plan.method.name,
        section_size=plan.method.section_size if plan.method.transforms else None,
        azimuths=plan.method.azimuths or None, precision="auto" if by_section else plan.precision,
        psf_energy=plan.psf_energy, accuracy=options.accuracy, wavelengths=wavelengths, seconds=np.nan,
        seconds_over_paper=np.nan, peak_mb=peak_mb, relative_l2=0.0, maximum_error=0.0, l1=0.0,
        predicted_bound=plan.error_bound, against="")


def _best_seconds(name, work, rounds, on_progress):
    """The minimum wall time of each of several simulations (radiance, lens, options).

    They take turns, so a short load on the machine does not affect all runs of one of them.
    """
    best = np.full(len(work), np.inf)
    for turn in range(1, rounds + 1):
        for index, (radiance, lens, options) in enumerate(work):
            on_progress(f"{name}: time, round {turn} of {rounds}", radiance.wavelengths_nm.size)
            begin = time.perf_counter()
            simulate(radiance, lens, options, cache=_nothing())
            best[index] = min(best[index], time.perf_counter() - begin)
    return best.tolist()


def _nothing():
    """The cache of a cold run: without memory and without earlier plans."""
    return ChannelCache(limit_mb=0, cache_plans=False)


def _with_times(rows, seconds):
    """The rows with their times, also relative to the row of the paper's method, if there is one."""
    paper_s = next((time_s for row, time_s in zip(rows, seconds, strict=True) if row.curve == AS_WRITTEN), None)
    return [replace(row, seconds=time_s, seconds_over_paper=paper_s and time_s / paper_s)
            for row, time_s in zip(rows, seconds, strict=True)]


def _traced(work):
    """The result of a function, and its peak memory in MB."""
    traced_before = tracemalloc.is_tracing()
    if not traced_before:
        tracemalloc.start()
    try:
        tracemalloc.reset_peak()
        held, _ = tracemalloc.get_traced_memory()
        result = work()
        return result, (tracemalloc.get_traced_memory()[1] - held) / 1e6
    finally:
        if not traced_before:
            tracemalloc.stop()


def errors(result: np.ndarray, exact: np.ndarray) -> dict[str, float]:
    """Relative errors of an array: {"relative_l2", "maximum_error", "l1"}, over norm, maximum and sum of `exact`."""
    difference, exact = np.abs(np.subtract(result, exact, dtype=np.float64)), np.abs(exact, dtype=np.float64)
    return {"relative_l2": float(np.linalg.norm(difference) / np.linalg.norm(exact)),
            "maximum_error": float(difference.max() / exact.max()), "l1": float(difference.sum() / exact.sum())}


def write_table(rows: list[Row], path: Path) -> None:
    """Write rows as CSV, atomically; cells for None are empty."""
    with atomic_path(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, [field.name for field in fields(Row)], lineterminator="\n")
        table.writeheader()
        for row in rows:
            table.writerow({name: f"{value:.7g}" if isinstance(value, float) else value
                            for name, value in asdict(row).items()})
