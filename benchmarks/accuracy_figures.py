"""Compare the engine with the paper's method at equal error, and check its light. Takes ten minutes.

    python benchmarks/accuracy_figures.py

Times are measured as in bench.py, on a checkerboard in the paper's frame, without black sections. Errors are relative
L2 errors of single lit pixels against the exact operator. For equal error, the paper's method needs smaller sections
of one PSF each: its time is interpolated, in log-log, between the two nearest of three section sizes.
"""

import numpy as np
from cases import NM, PAPER, PAPER_LENS, SENSOR_UM, checkerboard, points
from timing import machine, quickest

from lensfield.engine import Options, Report, SpectralImage, load_lens, simulate
from lensfield.engine.image.irradiance import irradiance_per_radiance
from lensfield.engine.inspection.tradeoff import errors

ACCURACIES = 0.1, 0.03, 0.01, 0.003, 1e-3, 1e-4
SECTIONS_PX = 16, 8, 4


def equal_error(lens):
    """Print seconds and errors by accuracy, and the paper's seconds for the same errors."""
    exact = simulate(points(), lens, Options(method="exact")).cube

    def measured(options, best_of=3):
        run = quickest(checkerboard(), lens, options, best_of=best_of)
        error = errors(simulate(points(), lens, options).cube, exact)["relative_l2"]
        return run.processor_s, error, run.report.lens_image.plan

    paper_s = quickest(checkerboard(), lens, PAPER).processor_s
    sections = [measured(Options(method="paper", section_size=size), 1)[:2] for size in SECTIONS_PX]
    for size, (seconds, error) in zip(SECTIONS_PX, sections, strict=True):
        print(f"one PSF in each {size} px: {seconds:.3f} s, {error:.1e}", flush=True)
    for accuracy in ACCURACIES:
        seconds, error, plan = measured(Options(accuracy=accuracy))
        print(f"accuracy {accuracy:g}: {seconds:.3f} s, {error:.1e}; {paper_s / seconds:.1f} times faster than the "
              f"paper, {seconds_at(error, sections) / seconds:.0f} times at equal error; {plan.text}", flush=True)


def seconds_at(error, sections):
    """The paper's seconds at this error, interpolated."""
    (s0, e0), (s1, e1) = sorted(sections, key=lambda each: abs(np.log(each[1] / error)))[:2]
    return s0 * (error / e0) ** (np.log(s1 / s0) / np.log(e1 / e0))


def conserved_light(lens):
    """Print the relative change of the light by the blur."""
    ways = {"the paper's method": PAPER} | {f"accuracy {each:g}": Options(accuracy=each) for each in (0.1, 0.01, 1e-3)}
    for name, options in ways.items():
        report = Report()
        simulate(checkerboard(), lens, options, report=report)
        energy = report.lens_image.energy
        print(f"relative change of the light by the blur, {name}: "
              f"{energy.out_w_per_nm / energy.in_w_per_nm - 1:+.0e}")


def uniform_light(lens, rows=576, columns=768, overscan_px=60):
    """Print the irradiance on the axis under uniform light, relative to Eq. 2."""
    shape = (1, rows + 2 * overscan_px, columns + 2 * overscan_px)
    image = SpectralImage(np.ones(shape), [NM], pitch_um=SENSOR_UM / columns, overscan_px=(overscan_px,) * 2)
    middle = simulate(image, lens).cube[0, rows // 2 - 1:rows // 2 + 1, columns // 2 - 1:columns // 2 + 1]
    per_radiance = irradiance_per_radiance(lens.at_wavelength(NM).transmittance, lens.f_number_effective)
    print(f"uniform light on the axis, relative to Eq. 2: {middle.mean() / per_radiance:.4f}")


def main():
    print(machine())
    for part in (uniform_light, conserved_light, equal_error):
        part(load_lens(PAPER_LENS))


if __name__ == "__main__":
    main()
