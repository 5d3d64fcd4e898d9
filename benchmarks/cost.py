"""The constants of the cost of plans: fitted to this machine, and checked."""

import time
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
from cases import HD, NM, ON_GRID, PAPER_LENS, QUARTER_HD, lens_of, night_street
from scipy.optimize import nnls
from timing import machine, without_cache

from lensfield.engine import Options, Report, simulate
from lensfield.engine.kernels.library import NUMPY, running
from lensfield.engine.plan import cost as costs
from lensfield.engine.plan.choose import workload

HOLD = 0.02  # weight of the present constants of filtering, relative to the cases
SMALL, BEST_OF = (253, 380), 3
OF_STAGES = {
    "lens data": ("wavelength", "window sample", "table sample", "table pixel", "table tap", "grid node"),
    "distortion and relative illumination": ("wavelength", "picture pixel", "grid pixel"),
    "filtering": ("wavelength", "picture pixel", "step", "transformed value", "spectrum value", "tap", "mixed tap",
                  "tap of a run", "turned sample")}
"""The kinds of work in each stage. Each stage is fitted separately; time outside these stages counts as filtering."""


def cost():
    """Fit the constants of engine/plan/cost.py to this machine, and check their accuracy.

    Prints NANOSECONDS and REFERENCE_S of this machine, for the default loops or the loops that LENSFIELD_KERNELS names.
    For fitted and for other cases, it prints the ratio of predicted to measured time, with the present constants,
    converted to this machine as in a plan, and with the new ones. Only processor time is measured, so the machine may
    be busy. The main thread's time counts as serial work, and the rest as work that all threads share.
    """
    without_cache()
    yield machine()
    loops = NUMPY if running() == NUMPY else costs.COMPILED
    first, others = ([case for case in (measured(*each) for each in cases) if case.single or loops == NUMPY]
                     for cases in (fitted_cases(), other_cases()))
    present = costs.NANOSECONDS[loops]
    here, present = fitted(first, present), converted(present)
    yield f"REFERENCE_S = {costs._look() * costs.REFERENCE_S:.2g}"
    for name, (alone, shared) in here.items():
        yield f'        "{name}": ({alone:g}, {shared:g}),'
    for kind, cases in (("fitted", first), ("not fitted", others)):
        yield f"{kind}: processor seconds; predicted over measured, with the present and with the new constants"
        for case in cases:
            now, then = (case.predicted(each) / case.total_s for each in (present, here))
            yield f"  {case.text}: {case.total_s:6.2f}  {now:5.2f} {then:5.2f}"


@dataclass
class Watched(Report):
    """A report that records the time of the main thread and of the other threads in each stage."""

    processor_s: dict = field(default_factory=dict)

    @contextmanager
    def stage(self, name):
        begin = _clocks()
        with super().stage(name):
            yield
        self.processor_s[name] = self.processor_s.get(name, 0) + _clocks() - begin


def _clocks():
    """Processor seconds of the main thread, and of the other threads."""
    alone = time.thread_time()
    return np.array([alone, time.process_time() - alone])


@dataclass(frozen=True, eq=False)
class Measured:
    """A measured case.

    `single` is whether compiled loops process it. `counts` is its work at all wavelengths by name; `stages` has the
    processor seconds (main thread, other threads) by stage.
    """

    text: str
    single: bool
    counts: dict
    stages: dict

    @property
    def total_s(self):
        return sum(self.stages.values()).sum()

    def predicted(self, nanoseconds):
        """Processor seconds, including the measured planning, which is complete before the prediction."""
        return self.stages["plan"].sum() + 1e-9 * sum(
            sum(each) * self.counts.get(name, 0) for name, each in nanoseconds.items())


def fitted_cases():
    """Cases (lens, shape, number of wavelengths, options) to fit the constants to."""
    for name in (PAPER_LENS, "nikkor-28mm", "kodak-petzval-100mm"):
        for shape, number in ((SMALL, 9), (QUARTER_HD, 1)):
            for accuracy in (0.1, 0.01, 0.001):
                yield name, shape, number, Options(method="pixels", accuracy=accuracy)
    for name in ("cooke-triplet-50mm", "nikkor-28mm"):
        for shape, number, accuracy in ((SMALL, 9, 0.01), (QUARTER_HD, 2, 0.01), (HD, 1, 0.01)):
            yield name + ON_GRID, shape, number, Options(accuracy=accuracy)
    for name in (PAPER_LENS, "apple-phone-4mm"):
        for size, azimuths in ((24, 16), (32, 4), (48, 32), (96, 8)):
            yield name, QUARTER_HD, 1, Options(section_size=size, azimuths=azimuths, psf_energy=0.99)
    for name, accuracy in ((PAPER_LENS, 0.03), ("nikkor-28mm", 0.01), ("angenieux-50mm", 0.01)):
        yield name, HD, 1, Options(method="pixels", accuracy=accuracy)
    yield PAPER_LENS, HD, 1, Options(section_size=64, azimuths=8, psf_energy=0.99)
    for size in (16, 64):
        yield PAPER_LENS, SMALL, 1, Options(method="paper", section_size=size)
        yield PAPER_LENS, QUARTER_HD, 1, Options(method="paper", section_size=size, precision="auto", psf_energy=0.99)
    yield PAPER_LENS, (60, 80), 1, Options(method="exact")


def other_cases():
    """Typical user cases, to check predictions."""
    for name in (PAPER_LENS, "tessar-50mm", "nikkor-28mm", "kodak-petzval-100mm", "angenieux-50mm",
                 "cooke-triplet-50mm", f"tessar-50mm{ON_GRID}"):
        for shape, number, accuracy in (((400, 600), 3, 0.1), ((576, 768), 1, 0.01), ((576, 768), 1, 0.001),
                                        (SMALL, 31, 0.01), (QUARTER_HD, 9, 0.05), (HD, 2, 0.1), (HD, 2, 0.01)):
            yield name, shape, number, Options(accuracy=accuracy)


def measured(name, shape, number, options):
    """Measure a case: the fastest of `BEST_OF` runs."""
    lens = lens_of(name)
    picture = night_street(lens, shape, np.linspace(420, 680, number) if number > 1 else np.array([NM]))
    best = None
    for _ in range(BEST_OF):
        report, fresh = Watched(), replace(lens)
        begin = _clocks()
        simulate(picture, fresh, options, report=report)
        stages = report.processor_s
        stages["else"] = _clocks() - begin - sum(stages.values())
        if best is None or sum(stages.values()).sum() < sum(best.values()).sum():
            best = stages
    plan = report.lens_image.plan
    counts = costs.counts(workload(plan, lens, picture.sampling), plan)
    text = (f"{name:30}{shape[1]:5} x {shape[0]:4} x {number:2}, {options.accuracy or '     '}: {plan.method.name:8} "
            f"{plan.method.section_size:3} px, {plan.method.azimuths:3} azimuths, radius {plan.psf_radius_px:3} px")
    return Measured(text, plan.precision == "float32", {name: count * number for name, count in counts.items()}, best)


def fitted(cases, present):
    """Constants fitted to measured cases, to replace the present ones."""
    constants = {name: np.zeros(2) for name in present}
    weights = 1 / np.array([case.total_s - case.stages["plan"].sum() for case in cases])
    for stage, kinds in OF_STAGES.items():
        kinds = [name for name in kinds if name in present]
        counts = np.array([[case.counts.get(name, 0) for name in kinds] for case in cases])
        took = np.array([case.stages[stage] + (case.stages["else"] if stage == "filtering" else 0) for case in cases])
        for thread, seconds in enumerate(took.T):
            now = np.array([present[name][thread] for name in kinds]) * (1e-9 if stage == "filtering" else 0)
            for name, value in zip(kinds, _held(counts * weights[:, None], seconds * weights, now), strict=True):
                constants[name][thread] += 1e9 * value
    return {name: tuple(float(f"{value:.2g}") for value in values) for name, values in constants.items()}


def _held(shares, took, now):
    """Non-negative least squares; constants that the cases do not determine stay at their present values."""
    scale = np.maximum(np.linalg.norm(shares, axis=0), 1e-300)
    held = np.vstack([shares / scale, HOLD * np.eye(scale.size)])
    return nnls(held, np.append(took, HOLD * now * scale))[0] / scale


def converted(nanoseconds):
    """Constants converted to this machine and its loops, as in `plan.cost.seconds`."""
    factor, slowness = costs.machine_factor(), costs.SLOWNESS.get(running(), 1.0)
    return {name: factor * (slowness if name in costs.LOOPS else 1.0) * np.array(each)
            for name, each in nanoseconds.items()}
