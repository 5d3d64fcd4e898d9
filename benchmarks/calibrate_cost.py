"""Fit the constants of engine/plan/cost.py to the machine at hand.

    python benchmarks/calibrate_cost.py

prints what NANOSECONDS and REFERENCE_S would be here, and how far predictions with them are from what was measured.
"""

import time
from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from lensfield.engine import Lens, Options, Report, SpectralImage, simulate
from lensfield.engine.plan import cost
from lensfield.engine.plan.choose import workload

LENS, NM, SENSOR_UM = "edmund-54852", 587.6, 4800
HOLD = 0.3  # how much the present constants count, beside the cases
BEST_OF = 3


def cases():
    """(lens, picture, options) over PSFs of few and of many pixels, all ways of filtering, one and many wavelengths."""
    lens = Lens.load(LENS)
    many = SpectralImage(np.random.default_rng(1).random((31, 253, 380)), np.linspace(400, 700, 31), SENSOR_UM / 380)
    for azimuths in (4, 16, 64):
        yield lens, many, Options(method="pixels", azimuths=azimuths)
    small, large = ((rows, columns) for rows, columns in ((576, 768), (1080, 1920)))
    for psf_pitch_um, shape in ((0.5, small), (0.5, large), (2.0, small), (6.25, small)):
        picture = SpectralImage(np.random.default_rng(1).random(shape), [NM], pitch_um=SENSOR_UM / shape[1])
        for options in (*(Options(method="pixels", azimuths=n) for n in (4, 64) if psf_pitch_um < 1 and shape == small),
                        *(Options(azimuths=n, section_size=size)
                          for n, size in ((4, 32), (4, 96), (16, 24), (16, 48), (32, 64))),
                        *(Options(method="paper", section_size=size, precision="auto") for size in (16, 64)),
                        Options(method="paper", section_size=64)):
            yield replace(lens, psf_pitch_um=psf_pitch_um), picture, options


def measured(lens, picture, options):
    """Counts of the work, and the least seconds of some runs without the plan's; and the plan."""
    seconds = []
    for _ in range(BEST_OF):
        report, begin = Report(), time.perf_counter()
        simulate(picture, lens, options, report=report)
        seconds.append(time.perf_counter() - begin - report.stages["plan"])
    plan = report.lens_image.plan
    own = cost.counts(workload(plan, lens, picture), plan)
    return {name: count * picture.wavelengths_nm.size for name, count in own.items()}, min(seconds), plan


def main():
    names = list(cost.NANOSECONDS)
    rows = [measured(*case) for case in cases()]
    counts = np.array([[row[0].get(name, 0) for name in names] for row in rows])
    seconds = np.array([row[1] for row in rows])
    now = np.array(list(cost.NANOSECONDS.values()))
    shares = counts * now / seconds[:, None] * 1e-9
    held = np.vstack([shares, HOLD * np.eye(now.size)])  # what the cases do not tell apart stays as it was
    fitted = now * nnls(held, np.append(np.ones(seconds.size), np.full(now.size, HOLD)))[0]
    cost.machine_factor.cache_clear()
    print(f"REFERENCE_S = {cost.machine_factor() * cost.REFERENCE_S:.2g}")
    for name, value in zip(names, fitted, strict=True):
        print(f'    "{name}": {value:.3g},')
    for (_, took, plan), predicted in zip(rows, counts @ fitted * 1e-9, strict=True):
        print(f"{plan.method.name:9}{plan.method.section_size:4} px, {plan.method.azimuths:3} azimuths, radius "
              f"{plan.psf_radius_px:2} px: {took:.3f} s, predicted / measured = {predicted / took:.2f}")


if __name__ == "__main__":
    main()
