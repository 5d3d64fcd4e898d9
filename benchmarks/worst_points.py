"""The points whose light a plan misplaces most: looked for over a picture, then by climbing from pixel to pixel.

    python benchmarks/worst_points.py [LENS ...]

A plan's bound is to be above the worst, and by no more than twice. Lenses of every kind, unless some are named.
"""

import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product

import numpy as np
from cases import LENSES, NM
from point_images import PointImages, point_images
from timing import machine

from lensfield.engine import Lens, Options, SpectralImage
from lensfield.engine.plan.choose import make_plan
from lensfield.engine.threads import thread_count

SHAPE_PX, WAVELENGTHS_NM = (576, 768), (420.0, NM, 680.0)
ACCURACIES = 0.1, 0.01, 0.001
MOST = 2.0  # of the bound over the worst
LOOKED_AT, CLIMBERS, CLIMBS, STEP_PX = 600, 10, 3, 2


def worst_error(images: PointImages, rng: np.random.Generator) -> float:
    """The largest error of a point that is found."""
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
    """The first of some places that are farther apart than this."""
    chosen = []
    for place in places:
        if len(chosen) < CLIMBERS and all(np.abs(place - other).max() > distance_px for other in chosen):
            chosen.append(place)
    return np.array(chosen)


def _climbed(images, start, best):
    """The worst places within a step of these, and their errors."""
    climbers, steps = start, np.arange(-STEP_PX, STEP_PX + 1)
    for step in product(steps, steps):
        places = np.clip(start + step, 0, np.array(images.grid.shape_px) - 1)
        errors = images.errors(places)
        climbers = np.where((errors > best)[:, None], places, climbers)
        best = np.maximum(errors, best)
    return climbers, best


def bound_and_worst(name: str, accuracy: float) -> tuple[float, float]:
    """What a plan promises for a lens, and the largest error found over its frame at some wavelengths."""
    lens, rng = Lens.load(name), np.random.default_rng(0)
    radiance = SpectralImage(np.zeros((len(WAVELENGTHS_NM), *SHAPE_PX)), WAVELENGTHS_NM,
                             pitch_um=1e3 * lens.sensor_mm[0] / SHAPE_PX[1])
    plan = make_plan(Options(accuracy=accuracy), lens, radiance)
    return plan.error_bound, max(worst_error(each, rng) for each in point_images(lens, radiance, plan))


def table_lines(names: list[str], accuracies: Sequence[float] = ACCURACIES) -> Iterator[str]:
    """The lines of a table, lens by lens as it comes."""
    yield f"{'bound / worst point found, at accuracy':<40}" + "".join(f"{each:>28g}" for each in accuracies)
    with ProcessPoolExecutor(thread_count()) as pool:
        rows = [(name, [pool.submit(bound_and_worst, name, accuracy) for accuracy in accuracies]) for name in names]
        for name, found in rows:
            yield f"{name:<40}" + "".join(f"{compared(*each.result()):>28}" for each in found)


def compared(bound, worst):
    missed = not worst <= bound <= MOST * worst
    return f"{bound:.2g} / {worst:.2g} = {bound / worst:.2f}{'!' if missed else ' '}"


if __name__ == "__main__":
    print(machine())
    for line in table_lines(sys.argv[1:] or LENSES):
        print(line, flush=True)
