"""Find the points whose light a plan misplaces most: search a picture, then refine by hill climbing.

    python benchmarks/worst_points.py [LENS ...]

A plan's bound must be at least the worst error, and at most twice as large. By default, a varied selection of lenses is
tested, and one of them sampled on a grid: "NAME on a grid". A second table compares the plan's bound for uniform light
with a picture of it: next to the axis or, on a grid, with finer pixels around nodes.
"""

import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import product

import numpy as np
from cases import LENSES, NM
from on_grid import ON_GRID, lens_of
from point_images import PointImages, point_images
from timing import machine

from lensfield.engine import Options, Report, SpectralImage, simulate
from lensfield.engine.field.radial.distortion import FieldGeometry
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.sampling import Sampling
from lensfield.engine.lens import GridLens
from lensfield.engine.plan.choose import make_plan
from lensfield.engine.runtime.threads import thread_count

SHAPE_PX, WAVELENGTHS_NM = (576, 768), (420.0, NM, 680.0)
ACCURACIES = 0.1, 0.01, 0.001
WIDTHS_PX, UNIFORM_PX, UNIFORM_ACCURACY = (192, 640, 1920), 16, 1e-3
MOST = 2.0  # limit of the bound relative to the worst error
LOOKED_AT, CLIMBERS, CLIMBS, STEP_PX = 600, 10, 3, 2
NODE_PX, EACH_NODE, FINER = 9, 2, 8  # pixels around a node; one in two nodes; parts of a pixel
PARTS_PX = 0, 0.5  # from the middle of a pixel to the node, in both directions


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


def table_lines(names: list[str], accuracies: Sequence[float] = ACCURACIES) -> Iterator[str]:
    """Yield the lines of the table, lens by lens."""
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
    missed = not worst <= bound <= MOST * worst
    return f"{bound:.2g} / {worst:.2g} = {bound / worst:.2f}{'!' if missed else ' '}"


if __name__ == "__main__":
    print(machine())
    for line in table_lines(sys.argv[1:] or [*LENSES, f"cooke-triplet-50mm{ON_GRID}"]):
        print(line, flush=True)
