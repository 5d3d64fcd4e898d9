"""Errors of lens images: by accuracy, by supersampling, by detail, and at the worst points."""

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from cases import HD, LENSES, NM, ON_GRID, PAPER, PAPER_LENS, SENSOR_UM, checkerboard, lens_of, lens_set_to, points
from timing import machine, marked, quickest, without_cache

from lensfield.engine import ChannelCache, Lens, Options, Report, SpectralImage, load_lens, simulate
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.mirror_symmetry import Planes
from lensfield.engine.field.overscan import choose_capture
from lensfield.engine.field.radial.distortion import FieldGeometry
from lensfield.engine.image.irradiance import irradiance_per_radiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.sampling import Sampling
from lensfield.engine.image.supersampling import merge_pixels
from lensfield.engine.inspection.tradeoff import errors
from lensfield.engine.lens import GridLens
from lensfield.engine.lens.pinhole import fitting_pitch_um
from lensfield.engine.plan.choose import make_plan
from lensfield.engine.plan.plan import Plan
from lensfield.engine.runtime.threads import thread_count
from lensfield.engine.simulation.channel import Channel

EQUAL_ACCURACIES, SECTIONS_PX = (0.1, 0.03, 0.01, 0.003, 1e-3, 1e-4), (16, 8, 4)

SHARP_LENSES = "tessar-50mm", "edmund-54852", "cooke-triplet-50mm", "nikkor-28mm"
PATCH_PX, MARGIN_PX, APART_PX, SQUARE_PX = 48, 12, 12, 8
TIMES, MOST_TIMES, FINE_ACCURACY, GREEN_NM = (1, 2, 3, 4), 8, 3e-3, 550.0

DETAILED = ("edmund-54852", "nikkor-z-50mm-f1.8:4", "nikkor-z-58mm-noct", "nikkor-z-35mm-f1.2", "olympus-fisheye-8mm",
          "apple-phone-4mm")
EDGE_FRAME_PX, EDGE_PX, REACH_PX = (512, 768), (54, 66), 12
FINEST, OVER = 6, 6
LAMP_PX, LAMPS_APART_PX, SLANT_RAD = 1.6, 11, np.deg2rad(6.1)
CYCLES_PER_PX = np.arange(1, 11) / 20
DETAIL_LEGEND = f"""\
lamps   misplaced light (L1) of lamps of {LAMP_PX} px
MTF     the largest difference in the edge's MTF, up to the Nyquist frequency
rim     the largest overshoot, or light below zero, of all pictures: relative to the edge's height"""

SHAPE_PX, WAVELENGTHS_NM = (576, 768), (420.0, NM, 680.0)
ACCURACIES = 0.1, 0.01, 0.001
WIDTHS_PX, UNIFORM_PX, UNIFORM_ACCURACY = (192, 640, 1920), 16, 1e-3
MOST = 2.0  # limit of the bound relative to the worst error
LOOKED_AT, CLIMBERS, CLIMBS, STEP_PX = 600, 10, 3, 2
NODE_PX, EACH_NODE, FINER = 9, 2, 8  # pixels around a node; one in two nodes; parts of a pixel
PARTS_PX = 0, 0.5  # from the middle of a pixel to the node, in both directions


def accuracy() -> Iterator[str]:
    """Compare the engine with the paper's method at equal error, and check its light. Takes ten minutes.

    Times are of a checkerboard in the paper's frame, without black sections. Errors are relative L2 errors of single
    lit pixels against the exact operator. For equal error, the paper's method needs smaller sections of one PSF each:
    its time is interpolated, in log-log, between the two nearest of three section sizes.
    """
    without_cache()
    yield machine()
    for part in (uniform_light, conserved_light, equal_error):
        yield from part(load_lens(PAPER_LENS))


def equal_error(lens):
    """Seconds and errors by accuracy, and the paper's seconds for the same errors."""
    exact = simulate(points(), lens, Options(method="exact")).cube

    def measured(options, best_of=3):
        run = quickest(checkerboard(), lens, options, best_of=best_of)
        error = errors(simulate(points(), lens, options).cube, exact)["relative_l2"]
        return run.processor_s, error, run.report.lens_image.plan

    paper_s = quickest(checkerboard(), lens, PAPER).processor_s
    sections = [measured(Options(method="paper", section_size=size), 1)[:2] for size in SECTIONS_PX]
    for size, (seconds, error) in zip(SECTIONS_PX, sections, strict=True):
        yield f"one PSF in each {size} px: {seconds:.3f} s, {error:.1e}"
    for accuracy in EQUAL_ACCURACIES:
        seconds, error, plan = measured(Options(accuracy=accuracy))
        yield (f"accuracy {accuracy:g}: {seconds:.3f} s, {error:.1e}; {paper_s / seconds:.1f} times faster than the "
               f"paper, {seconds_at(error, sections) / seconds:.0f} times at equal error; {plan.text}")


def seconds_at(error, sections):
    """The paper's seconds at this error, interpolated."""
    (s0, e0), (s1, e1) = sorted(sections, key=lambda each: abs(np.log(each[1] / error)))[:2]
    return s0 * (error / e0) ** (np.log(s1 / s0) / np.log(e1 / e0))


def conserved_light(lens):
    """The relative change of the light by the blur."""
    ways = {"the paper's method": PAPER} | {f"accuracy {each:g}": Options(accuracy=each) for each in (0.1, 0.01, 1e-3)}
    for name, options in ways.items():
        report = Report()
        simulate(checkerboard(), lens, options, report=report)
        energy = report.lens_image.energy
        yield (f"relative change of the light by the blur, {name}: "
               f"{energy.out_w_per_nm / energy.in_w_per_nm - 1:+.0e}")


def uniform_light(lens, rows=576, columns=768, overscan_px=60):
    """The irradiance on the axis under uniform light, relative to Eq. 2."""
    shape = (1, rows + 2 * overscan_px, columns + 2 * overscan_px)
    image = SpectralImage(np.ones(shape), [NM], pitch_um=SENSOR_UM / columns, overscan_px=(overscan_px,) * 2)
    middle = simulate(image, lens).cube[0, rows // 2 - 1:rows // 2 + 1, columns // 2 - 1:columns // 2 + 1]
    per_radiance = irradiance_per_radiance(lens.at_wavelength(NM).transmittance, lens.f_number_effective)
    yield f"uniform light on the axis, relative to Eq. 2: {middle.mean() / per_radiance:.4f}"


def supersampling() -> Iterator[str]:
    """Measure the effect of supersampling by lens: misplaced light at 1 x 1 to 4 x 4, compared with 8 x 8.

    The pictures are a patch in the middle of a 1080p frame of each lens, at 550 nm: single lit pixels, 12 apart, and a
    checkerboard of 8 px squares. Errors are sums of |error| as fractions of the light, like `accuracy`, and include its
    error, at most 0.003. Processor seconds are for one patch. (Away from the axis, 8 x 8 would need a table of 40 GB.)
    """
    yield f"{'':<20}{'um/px':>6}  {'':<8}" + "".join(f"{f'{n} x {n}':>9}" for n in TIMES) + "   processor s"
    for name in SHARP_LENSES:
        lens = load_lens(name)
        pitch_um = fitting_pitch_um(lens, HD)
        for what, picture in patches().items():
            true = filtered(picture, pitch_um, lens, MOST_TIMES)[0]
            results = [filtered(picture, pitch_um, lens, times) for times in TIMES]
            misplaced = "".join(f"{np.abs(result - true).sum() / true.sum():9.4f}" for result, _ in results)
            seconds = ", ".join(f"{took:.2f}" for _, took in results)
            yield f"{name:<20}{pitch_um:6.2f}  {what:<8}{misplaced}   {seconds}"


def patches():
    """Points and a checkerboard, with a margin to avoid loss of light: dict of arrays."""
    side = np.arange(PATCH_PX)
    points = np.outer(side % APART_PX == APART_PX // 2, side % APART_PX == APART_PX // 2)
    board = (np.add.outer(side // SQUARE_PX, side // SQUARE_PX) % 2).astype(bool)
    return {name: np.pad(picture, MARGIN_PX).astype(np.float32) for name, picture in
            (("points", points), ("board", board))}


def filtered(picture, pitch_um, lens, times):
    begin = time.process_time()
    radiance = SpectralImage(picture, [GREEN_NM], pitch_um=pitch_um)
    result = simulate(radiance, lens, Options(accuracy=FINE_ACCURACY, supersampling=times))
    return result.cube[0].astype(float), time.process_time() - begin


def sharpness(lenses=DETAILED, *, pitches=(1.0,), parts: int = 2) -> Iterator[str]:
    """Sharpness of in-focus light, without and with detail: misplaced light of lamps, and the MTF of an edge.

    The scene is drawn: lamps of 1.6 px at random places, and a slightly slanted edge. A patch of it, halfway to the
    corner of a frame, is imaged at 550 nm from a capture in the frame's pixels, with their even light and with detail
    of `parts` x `parts` parts. Both are compared with the image in pixels that are 6 times finer, merged. Lenses are
    NAME[:F-NUMBER], and `pitches` relative to 768 x 512 px on the lens's sensor.
    """
    yield DETAIL_LEGEND
    yield f"{'':<24}{'um/px':>7}" + "".join(f"{name:>24}" for name in ("without detail", f"{parts} x {parts} parts"))
    yield " " * 31 + 2 * f"{'lamps':>8}{'MTF':>8}{'rim':>8}"
    for name in lenses:
        lens = lens_set_to(name)
        for pitch in pitches:
            frame = PixelGrid([round(n / pitch) for n in EDGE_FRAME_PX], pitch * fitting_pitch_um(lens, EDGE_FRAME_PX))
            yield f"{name.partition(':')[0]:<24}{frame.pitch_um:7.2f}{detail_cells(lens, frame, parts)}"


def patch_grid(lens, frame):
    """A patch halfway to the corner with enough overscan, PixelGrid; and the middle of the patch in its capture."""
    capture = choose_capture(lens, frame, [GREEN_NM], REACH_PX)
    centre = [(side - 1) / 2 - n / 4 for side, n in zip(EDGE_PX, frame.shape_px, strict=True)]
    grid = PixelGrid(EDGE_PX, frame.pitch_um, tuple(centre), projection=capture.projection)
    x_mm, y_mm = grid.axes_mm()
    place = field_map(lens).at_wavelength(GREEN_NM).source_mm(x_mm, y_mm[:, None], grid)
    rows, columns = (np.broadcast_to(each, EDGE_PX) for each in grid.index_of(*place))
    moved = max(np.abs(rows - np.arange(EDGE_PX[0])[:, None]).max(), np.abs(columns - np.arange(EDGE_PX[1])).max())
    middle = [each[EDGE_PX[0] // 2, EDGE_PX[1] // 2] for each in (rows, columns)]
    return grid.framed(int(np.ceil(moved)) + REACH_PX), middle


def lamps(grid, times):
    """Lamps in pixels of `times` finer pixels, drawn exactly: array (row, column)."""
    rng = np.random.default_rng(5)
    ends = [np.arange(times * n + 1) / times - 0.5 for n in grid.shape_px]
    picture = np.zeros([times * n for n in grid.shape_px], np.float32)
    for row in np.arange(8, grid.shape_px[0] - 8, LAMPS_APART_PX):
        for column in np.arange(8, grid.shape_px[1] - 8, LAMPS_APART_PX):
            place = np.array([row, column]) + 2 * rng.random(2)
            down, across = (times * np.diff(np.clip(end, at - LAMP_PX / 2, at + LAMP_PX / 2))
                            for end, at in zip(ends, place, strict=True))
            picture += np.outer(down, across).astype(np.float32)
    return picture


def edge(grid, times, middle):
    """An edge through the middle of the patch, in `times` finer pixels: array (row, column)."""
    fine = 24 // times
    rows, columns = ((np.arange(24 * n) + 0.5) / 24 - 0.5 - overscan - at
                     for n, overscan, at in zip(grid.shape_px, grid.overscan_px, middle, strict=True))
    distance = columns * np.cos(SLANT_RAD) + rows[:, None] * np.sin(SLANT_RAD)
    return merge_pixels(np.clip(24 * distance + 0.5, 0, 1), fine).astype(np.float32)


def response(picture):
    """The MTF of a nearly vertical edge at CYCLES_PER_PX, from pixels by their distance to the edge."""
    columns, steps = np.arange(picture.shape[1]), np.diff(picture, axis=1)
    rows = np.arange(len(steps))
    line = np.polyfit(rows, (steps * (columns[1:] - 0.5)).sum(axis=1) / steps.sum(axis=1), 2)
    slope = np.polyval(np.polyder(line), rows)
    distance = (columns - np.polyval(line, rows)[:, None]) / np.hypot(1, slope)[:, None]
    bins = np.round(OVER * distance).astype(int)
    first, bins = bins.min(), bins - bins.min()
    count = np.bincount(bins.ravel())
    profile = np.bincount(bins.ravel(), picture.ravel())[count > 0] / count[count > 0]
    spread = np.diff(profile[np.abs((np.flatnonzero(count) + first) / OVER) < REACH_PX])
    waves = np.exp(-2j * np.pi * np.outer(CYCLES_PER_PX, np.arange(spread.size) / OVER))
    return np.abs(waves @ spread) / spread.sum() / np.sinc(CYCLES_PER_PX / OVER)**2  # of bins and differences


def edge_images(lens, grid, middle, times, finer=False):
    """The lens images of lamps and edge from a capture with `times` parts of each pixel; with `finer`, of such pixels,
    merged."""
    cache = ChannelCache()
    for picture in (lamps(grid, times), edge(grid, times, middle)):
        radiance = SpectralImage(picture[None], [GREEN_NM], grid.finer(times))
        image = radiance if finer or times == 1 else radiance.coarser(times)
        irradiance = simulate(image, lens, Options(accuracy=FINE_ACCURACY), cache=cache).cube[0].astype(float)
        yield merge_pixels(irradiance, times) if finer else irradiance


def detail_cells(lens, frame, parts):
    """A row of cells: for even pixels and for detail."""
    grid, middle = patch_grid(lens, frame)
    true = list(edge_images(lens, grid, middle, FINEST, finer=True))
    cells = ""
    for times in (1, parts):
        lamp, edges = edge_images(lens, grid, middle, times)
        misplaced = np.abs(lamp - true[0]).sum() / true[0].sum()
        error = np.abs(response(edges[6:-6, 6:-6]) - response(true[1][6:-6, 6:-6])).max()
        rim = max(edges.max() - true[1].max(), -edges.min(), -lamp.min()) / true[1].max()
        cells += f"{misplaced:8.3f}{error:8.3f}{max(0.0, rim):8.1%}"
    return cells


@dataclass(frozen=True, eq=False)
class PointImages:
    """The images of single pixels of a grid, at one wavelength. Places are arrays (place, 2): row and column."""

    lens: Lens
    wavelength_nm: float
    grid: PixelGrid
    channel: Channel
    radius_px: int

    def by_plan(self, places: np.ndarray) -> np.ndarray:
        """Images of pixels under the plan: array (place, row, column). The images must not overlap."""
        picture = np.zeros(self.grid.shape_px, np.float32)
        picture[tuple(places.T)] = 1
        blurred, side = self.channel.blur(self.channel.planes.split(picture)), 2 * self.radius_px + 1
        return np.stack([blurred[row:row + side, column:column + side] for row, column in places])

    def errors(self, places: np.ndarray) -> np.ndarray:
        """Misplaced fraction of each pixel's light: the sum of |difference| from the exact image."""
        true = self._true_psfs.psfs(*places.T)
        rim = (true.shape[-1] - (2 * self.radius_px + 1)) // 2
        return np.abs(np.pad(self.by_plan(places), ((0, 0), (rim, rim), (rim, rim))) - true).sum(axis=(1, 2))

    def some_places(self, rng: np.random.Generator) -> np.ndarray:
        """A grid of places as dense as images allow without overlap, from a random start."""
        spacing = 2 * self.radius_px + 1
        rows, columns = (np.arange(rng.integers(min(spacing, n)), n, spacing) for n in self.grid.shape_px)
        return np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)

    @cached_property
    def _true_psfs(self):
        return field_map(self.lens).at_wavelength(self.wavelength_nm).psfs(lambda psfs: psfs, Planes(self.grid, False))


def point_images(lens: Lens, radiance: SpectralImage, plan: Plan) -> list[PointImages]:
    """Point images for a picture without overscan, at each wavelength. Pixels count as dim and get no halos."""
    channels = ChannelCache(0).channels(lens, radiance.sampling, replace(plan, halo_energy=None, halo_radius_px=0))
    return [PointImages(lens, nm, radiance.grid, channel, plan.psf_radius_px)
            for channel, nm in zip(channels, radiance.wavelengths_nm, strict=True)]


def worst(lenses=(*LENSES, f"cooke-triplet-50mm{ON_GRID}")) -> Iterator[str]:
    """Find the points whose light a plan misplaces most: search a picture, then refine by hill climbing.

    A plan's bound must be at least the worst error, and at most twice as large. By default, a varied selection of
    lenses is tested, and one of them sampled on a grid: "NAME on a grid". A second table compares the plan's bound for
    uniform light with a picture of it: next to the axis or, on a grid, with finer pixels around nodes.
    """
    without_cache()
    yield machine()
    yield from worst_lines(lenses)


def worst_error(images: PointImages, rng: np.random.Generator) -> float:
    """The largest error found for a point."""
    places, errors = np.empty((0, 2), int), np.empty(0)
    while errors.size < LOOKED_AT:
        more = images.some_places(rng)
        places, errors = np.concatenate([places, more]), np.append(errors, images.errors(more))
    climbers = _apart(places[np.argsort(-errors)], 2 * (images.radius_px + CLIMBS * STEP_PX))
    best = images.errors(climbers)
    for _ in range(CLIMBS):
        climbers, best = _climbed(images, climbers, best)
    return float(best.max())


def _apart(places, distance_px):
    """Up to `CLIMBERS` of the points, in order, that are farther apart than this."""
    chosen = []
    for place in places:
        if len(chosen) < CLIMBERS and all(np.abs(place - other).max() > distance_px for other in chosen):
            chosen.append(place)
    return np.array(chosen)


def _climbed(images, start, best):
    """The worst points within `STEP_PX` of these, and their errors."""
    climbers, steps = start, np.arange(-STEP_PX, STEP_PX + 1)
    for step in product(steps, steps):
        places = np.clip(start + step, 0, np.array(images.grid.shape_px) - 1)
        errors = images.errors(places)
        climbers = np.where((errors > best)[:, None], places, climbers)
        best = np.maximum(errors, best)
    return climbers, best


def bound_and_worst(name: str, accuracy: float) -> tuple[float, float]:
    """A plan's bound for a lens, and the largest error in its frame at three wavelengths."""
    lens, rng = lens_of(name), np.random.default_rng(0)
    radiance = SpectralImage(np.zeros((len(WAVELENGTHS_NM), *SHAPE_PX)), WAVELENGTHS_NM,
                             pitch_um=1e3 * lens.sensor_mm[0] / SHAPE_PX[1])
    plan = make_plan(Options(accuracy=accuracy), lens, radiance.sampling)
    return plan.error_bound, max(worst_error(each, rng) for each in point_images(lens, radiance, plan))


def uniform_bound_and_worst(name: str, width_px: int) -> tuple[float, float]:
    """A plan's bound for uniform light, and the largest error of a picture of it."""
    lens = lens_of(name)
    return _around_nodes(lens, width_px) if isinstance(lens, GridLens) else _around_axis(lens, width_px)


def _around_nodes(lens, width_px):
    pitch_um, worst = 1e3 * lens.sensor_mm[0] / width_px, 0.0
    complete = PixelGrid((round(width_px * lens.sensor_mm[1] / lens.sensor_mm[0]), width_px), pitch_um)
    plan = make_plan(Options(accuracy=UNIFORM_ACCURACY), lens, Sampling(complete, WAVELENGTHS_NM))
    moved_mm = np.abs(lens.source_mm - np.stack(np.meshgrid(lens.x_mm, lens.y_mm), axis=-1)).max()
    around_px = plan.psf_radius_px + NODE_PX + int(np.ceil(1e3 * moved_mm / pitch_um))
    around = replace(PixelGrid.around_frame((NODE_PX, NODE_PX), pitch_um, (around_px,) * 2), squeeze=lens.squeeze)
    for *place_mm, part_px in product(*(axis_mm[1:-1:EACH_NODE] for axis_mm in (lens.x_mm, lens.y_mm)), PARTS_PX):
        grid = around.shifted(*np.divide(place_mm, pitch_um * 1e-3) + part_px)
        even = SpectralImage(np.ones((len(WAVELENGTHS_NM), *grid.shape_px)), WAVELENGTHS_NM, grid)
        coarse, fine = (simulate(even, lens, Options(method="pixels", psf_energy=plan.psf_energy, supersampling=times)
                                ).cube for times in (1, FINER))
        worst = max(worst, np.abs(coarse / fine - 1).max())
    return plan.uniform_light_error, float(worst)


def _around_axis(lens, width_px):
    around_px = UNIFORM_PX + lens.psf.shape[-1] * lens.psf_pitch_um * width_px / (1e3 * lens.sensor_mm[0])
    grid = PixelGrid.around_frame((UNIFORM_PX, UNIFORM_PX), 1e3 * lens.sensor_mm[0] / width_px, (int(around_px),) * 2)
    even = SpectralImage(np.ones((len(WAVELENGTHS_NM), *grid.shape_px)), WAVELENGTHS_NM, grid)
    report = Report()
    picture = simulate(even, lens, Options(accuracy=UNIFORM_ACCURACY), report=report).cube
    x_mm, y_mm = grid.frame().axes_mm()
    distance_mm, worst = np.hypot(x_mm, y_mm[:, None]), 0.0
    for nm, plane in zip(WAVELENGTHS_NM, picture, strict=True):
        optics = lens.at_wavelength(nm)
        field = FieldGeometry(optics, lens.name)
        moved = plane / field.relative_flux(field.paraxial_height_mm(distance_mm))
        distance_px = distance_mm / (grid.pitch_um * 1e-3)
        around = moved[(distance_px > 5) & (distance_px < 7)].mean()
        worst = max(worst, np.abs(moved[distance_px < 3] / around - 1).max())
    return report.lens_image.plan.uniform_light_error, float(worst)


def worst_lines(names: Sequence[str], accuracies: Sequence[float] = ACCURACIES) -> Iterator[str]:
    """Yield the lines of the tables, lens by lens."""
    yield f"{'bound / worst point found, at accuracy':<40}" + "".join(f"{each:>28g}" for each in accuracies)
    with ProcessPoolExecutor(thread_count()) as pool:
        rows = [(name, [pool.submit(bound_and_worst, name, accuracy) for accuracy in accuracies]) for name in names]
        for name, results in rows:
            yield f"{name:<40}" + "".join(f"{compared(*each.result()):>28}" for each in results)
        yield f"{'bound / worst of uniform light, at width':<40}" + "".join(f"{each:>28d}" for each in WIDTHS_PX)
        rows = [(name, [pool.submit(uniform_bound_and_worst, name, width) for width in WIDTHS_PX]) for name in names]
        for name, results in rows:
            yield f"{name:<40}" + "".join(f"{compared(*each.result()):>28}" for each in results)


def compared(bound, worst):
    return marked(f"{bound:.2g} / {worst:.2g} = {bound / worst:.2f}", not worst <= bound <= MOST * worst)
