"""One case of cases.py through the engine that Python finds, today's or an earlier one, in a process of its own.

    python benchmarks/measure_case.py '{"name": "768x576, 0.01", "options": {"accuracy": 0.01}, "best_of": 3}'

prints what that took as a line of JSON. `wavelengths` takes a part of them; of two `frames` the second finds what the
first has kept; `floor` adds what the plan's multiply-adds would take alone.
"""

import json
import resource
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from cases import CASES, PAPER_LENS
from timing import multiply_adds_per_s, quickest

from lensfield import engine
from lensfield.engine import Lens, Options, SpectralImage


def main(name, options, best_of, wavelengths=None, frames=1, floor=False):
    case, options = CASES[name], Options(**options)
    lens = Lens.load(case.lens)
    radiance = case.radiance(lens)
    if wavelengths:
        radiance = spread_out(radiance, wavelengths)
    warm_up = SpectralImage(np.ones((16, 16)), [500], pitch_um=10)
    quickest(warm_up, Lens.load(PAPER_LENS), Options())
    run = quickest(radiance, lens, options, best_of, frames, radiance.cube if case.in_place else None)
    plan = run.report.lens_image.plan
    facts = {"processor_s": run.processor_s, "waited_s": run.waited_s, "later_s": run.later_s,
             "predicted_s": plan.seconds, "bound": plan.error_bound, "way": plan.method.text,
             "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
             "engine": str(Path(engine.__file__).parent)}
    if floor and not plan.method.transforms:
        from point_images import multiply_adds
        facts["floor_s"] = multiply_adds(lens, radiance, plan) / multiply_adds_per_s()
    print(json.dumps(facts))


def spread_out(radiance, count):
    """So many of a picture's wavelengths, in even steps, the first and the last aside."""
    some = np.linspace(0, radiance.wavelengths_nm.size - 1, count + 2).round().astype(int)[1:-1]
    return replace(radiance, cube=radiance.cube[some], wavelengths_nm=radiance.wavelengths_nm[some])


if __name__ == "__main__":
    main(**json.loads(sys.argv[1]))
