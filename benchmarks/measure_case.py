"""Run one case of cases.py through the engine, in a separate process.

    python benchmarks/measure_case.py '{"name": "768x576, 0.01", "options": {"accuracy": 0.01}, "best_of": 3}'

prints time and memory as a line of JSON. `wavelengths` limits their number. With two `frames`, the second uses the
channels that the first has cached.
"""

import json
import resource
import sys
from dataclasses import replace

import numpy as np
from cases import CASES, PAPER_LENS
from timing import quickest

from lensfield.engine import Options, SpectralImage, load_lens


def main(name, options, best_of, wavelengths=None, frames=1):
    case, options = CASES[name], Options(**options)
    lens = load_lens(case.lens)
    radiance = case.radiance(lens)
    if wavelengths:
        radiance = spread_out(radiance, wavelengths)
    warm_up = SpectralImage(np.ones((16, 16)), [500], pitch_um=10)
    quickest(warm_up, load_lens(PAPER_LENS), Options())
    run = quickest(radiance, lens, options, best_of, frames, radiance.cube if case.in_place else None)
    plan = run.report.lens_image.plan
    facts = {"processor_s": run.processor_s, "waited_s": run.waited_s, "later_s": run.later_s,
             "predicted_s": plan.seconds, "bound": plan.error_bound, "way": plan.method.text,
             "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3}
    print(json.dumps(facts))


def spread_out(radiance, count):
    """Reduce a picture to `count` evenly spaced wavelengths, without the first and the last."""
    some = np.linspace(0, radiance.wavelengths_nm.size - 1, count + 2).round().astype(int)[1:-1]
    return replace(radiance, cube=radiance.cube[some], wavelengths_nm=radiance.wavelengths_nm[some])


if __name__ == "__main__":
    main(**json.loads(sys.argv[1]))
