"""What the engine's accuracy costs, and what it is worth: seconds, errors and memory on stated pictures.

    python benchmarks/engine_figures.py

Times are cold: a lens fresh from its data, the plan, PSFs and OTFs included, the best of three runs; without importing
modules and without files. Each is set against the paper's method in the same run: its sections of 16 px with one PSF
each, as it writes them, and such sections cut so small that they reach the same error. Errors are against the exact
operator, every pixel turning its own PSF; of large pictures against pixels with 512 azimuths, whose own bound is told.
"""

import os
import platform
import resource
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import scipy
from paper_section_4 import checkerboard, relative_l2
from scipy import fft

from lensfield.engine import Kept, Lens, Options, Report, SpectralImage, simulate
from lensfield.engine.blur import isoplanatic, polar_sections
from lensfield.engine.spectral.spectra import blackbody

LENS = "edmund-54852"
NM = 587.6
PITCH_UM = 6.25
SENSOR_UM = 4800
BEST_OF = 3
PAPER = Options(method="paper")
FINE = Options(azimuths=256, section_size=48)
NEARLY_EXACT = Options(method="pixels", azimuths=512, psf_energy=1.0, precision="float64")


def points(rows=576, columns=768, spacing_px=37):
    """Single lit pixels: the picture that forgives least."""
    plane = np.zeros((rows, columns))
    plane[spacing_px // 2::spacing_px, spacing_px // 2::spacing_px] = 1
    return SpectralImage(plane, [NM], pitch_um=SENSOR_UM / columns)


def multispectral(rows=253, columns=380, square_px=12):
    """31 wavelengths of tungsten light on a coarse chequered pattern with points in it."""
    nm = np.linspace(400, 700, 31)
    row, column = np.mgrid[:rows, :columns]
    pattern = 0.1 + 0.9 * ((row // square_px + column // square_px) % 2)
    pattern[::31, ::31] += 5
    return SpectralImage(blackbody(2856).at(nm)[:, None, None] * pattern, nm, pitch_um=SENSOR_UM / columns)


def fresh_lens(window_um=None):
    """The lens with nothing remembered of earlier runs; its PSFs scaled to a window of this width, if any."""
    lens = Lens.load(LENS)
    return replace(lens, psf_pitch_um=window_um / lens.psf.shape[-1] if window_um else lens.psf_pitch_um)


def timed(image, options, window_um=None, best_of=BEST_OF):
    """The picture, the least seconds of some cold runs, and the report of the last."""
    seconds = []
    for _ in range(best_of):
        lens, report = fresh_lens(window_um), Report()
        begin = time.perf_counter()
        result = simulate(image, lens, options, report=report)
        seconds.append(time.perf_counter() - begin)
    return result, min(seconds), report


class Frame:
    """The paper's frame at one wavelength, with PSFs of some size: what is exact for it, and the paper's method.

    `hard` are the paper's sections at several sizes: (seconds, relative L2 error of the points). Seconds are those of
    the checkerboard, where no section is black. Where the exact operator would take many minutes for it, 256 azimuths
    stand for that.
    """

    def __init__(self, name, window_um, board_exactly):
        self._window_um = window_um
        print(name)
        self._exact, boards = {}, Options(method="exact") if board_exactly else FINE
        for picture, image, options in (("points", points(), Options(method="exact")),
                                        ("checkerboard", checkerboard(), boards)):
            self._exact[picture], seconds, _ = timed(image, options, window_um, best_of=1)
            print(f"  {picture}, {options.method}{' operator' if options.method == 'exact' else ', 256 azimuths'}: "
                  f"{seconds:.1f} s")
        self._paper_s, errors, _ = self._measure(PAPER)
        print(f"  {'the paper as written':<24}{self._paper_s:8.3f} s  {errors_text(errors)}")
        self._hard = []
        for size in (16, 8, 4):
            seconds, errors, _ = self._measure(Options(method="paper", section_size=size), best_of=1)
            self._hard.append((seconds, errors["points"]))
            print(f"  {f'hard sections, {size} px':<24}{seconds:8.3f} s  {errors_text(errors)}")

    def _measure(self, options, best_of=BEST_OF):
        """Seconds, relative L2 errors by picture, and the plan."""
        board, seconds, report = timed(checkerboard(), options, self._window_um, best_of)
        results = {"points": timed(points(), options, self._window_um, best_of=1)[0], "checkerboard": board}
        errors = {picture: relative_l2(results[picture], exact) for picture, exact in self._exact.items()}
        return seconds, errors, report.lens_image.plan

    def _hard_seconds(self, error):
        """Seconds of hard sections with this error: on the line, in log-log, through the two nearest."""
        (s0, e0), (s1, e1) = sorted(self._hard, key=lambda hard: abs(np.log(hard[1] / error)))[:2]
        return s0 * (error / e0) ** (np.log(s1 / s0) / np.log(e1 / e0))

    def tell(self, name, options):
        seconds, errors, plan = self._measure(options)
        ratio = self._hard_seconds(errors["points"]) / seconds
        print(f"  {name:<24}{seconds:8.3f} s  {errors_text(errors)}; the paper's time / this: "
              f"{self._paper_s / seconds:.1f}, at equal error {ratio:.0f}; {plan.text}")


def errors_text(errors):
    return ", ".join(f"{picture} {error:.1e}" for picture, error in errors.items())


ASKED = [(f"accuracy {accuracy:g}", Options(accuracy=accuracy)) for accuracy in (0.1, 0.03, 0.01, 0.003, 1e-3, 1e-4)]


def small_frames():
    frame = Frame("768 x 576, 587.6 nm, windows of 18 px", None, board_exactly=True)
    for name, options in (*ASKED,
                          *((f"pixels, {n} azimuths", Options(method="pixels", azimuths=n)) for n in (4, 8, 16))):
        frame.tell(name, options)
    frame = Frame("768 x 576, 587.6 nm, enlarged to windows of 64 px", 64 * PITCH_UM, board_exactly=False)
    for name, options in (*ASKED[:4], *((f"sections, {n} azimuths", Options(azimuths=n, section_size=96))
                                        for n in (3, 4, 6, 8))):
        frame.tell(name, options)


def many_wavelengths():
    image = multispectral()
    exact, _, _ = timed(image, NEARLY_EXACT, best_of=1)
    _, paper_s, _ = timed(image, PAPER)
    print(f"380 x 253, 31 wavelengths: the paper as written {paper_s:.2f} s")
    for name, options in (*ASKED[:5], ("pixels, 4 azimuths", Options(method="pixels", azimuths=4))):
        result, seconds, report = timed(image, options)
        print(f"  {name:<24}{seconds:8.3f} s  relative L2 {relative_l2(result, exact):.1e}; the paper's time / this: "
              f"{paper_s / seconds:.1f}; {report.lens_image.plan.text}")


def scene(rows, columns):
    """Patches and noise."""
    rng = np.random.default_rng(1)
    patches = rng.random((-(-rows // 24), -(-columns // 24)))
    return np.kron(patches, np.ones((24, 24)))[:rows, :columns] + 0.1 * rng.random((rows, columns))


def large_frame(knobs):
    """3840 x 2160 at 31 wavelengths, in a process of its own for its memory's sake."""
    options = _options(knobs)
    cube = np.empty((31, 2160, 3840), np.float32)
    cube[:] = scene(2160, 3840)
    image = SpectralImage(cube, np.linspace(400, 700, 31), pitch_um=SENSOR_UM / 3840)
    report, begin = Report(), time.perf_counter()
    simulate(image, fresh_lens(), options, report=report, out=cube)
    seconds, peak_mb = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    stages = ", ".join(f"{stage} {taken:.1f} s" for stage, taken in report.stages.items())
    print(f"{seconds:.1f} s, {seconds / 31:.2f} s a wavelength; peak {peak_mb:.0f} MB, of it "
          f"{cube.nbytes / 1e6:.0f} MB the picture; {report.lens_image.plan.text}; {stages}")


def large_frames():
    print("3840 x 2160, 31 wavelengths, in place")
    image = SpectralImage(scene(2160, 3840), [NM], pitch_um=SENSOR_UM / 3840)
    exact, _, _ = timed(image, FINE, best_of=1)
    for text in (["accuracy=0.1"], ["accuracy=0.03"], ["accuracy=0.01"], ["section_size=64", "azimuths=4"]):
        knobs = [knob.split("=") for knob in text]
        options = _options(knobs)
        error = relative_l2(timed(image, options, best_of=1)[0], exact)
        print(f"  {', '.join(text)}: relative L2 {error:.1e} at {NM} nm;", end=" ", flush=True)
        subprocess.run([sys.executable, __file__, "--large-frame", *text], check=True)


def _options(knobs):
    return Options(**{name: float(value) if name == "accuracy" else int(value) for name, value in knobs})


def flatness():
    """Cost per pixel from 0.1 to 33 megapixels, with PSFs of the same size in pixels."""
    print("one wavelength, windows of 18 px, accuracy 0.01: microseconds per pixel")
    for rows, columns in ((253, 380), (576, 768), (1080, 1920), (2160, 3840), (4320, 7680)):
        image = SpectralImage(scene(rows, columns), [NM], pitch_um=SENSOR_UM / columns)
        _, seconds, report = timed(image, Options(accuracy=0.01), 18 * image.pitch_um)
        size = rows * columns
        print(f"  {size / 1e6:5.1f} megapixels: {seconds / size * 1e6:.3f}, without the plan "
              f"{(seconds - report.stages['plan']) / size * 1e6:.3f}; {report.lens_image.plan.text}")


def animation():
    print("the second frame of an animation over the first")
    for name, image, options in (("768 x 576", checkerboard(), Options(accuracy=0.01)),
                                 ("768 x 576", checkerboard(), Options(section_size=32)),
                                 ("380 x 253, 31 wavelengths", multispectral(), Options(accuracy=0.01)),
                                 ("1920 x 1080", checkerboard(1080, 1920), Options(accuracy=0.03))):
        ratios = []
        for _ in range(BEST_OF):
            lens, kept, seconds = fresh_lens(), Kept(), []
            for _ in range(2):
                begin = time.perf_counter()
                simulate(image, lens, options, kept=kept)
                seconds.append(time.perf_counter() - begin)
            ratios.append(seconds[1] / seconds[0])
        print(f"  {name}, {options.accuracy or '32 px sections'}: {np.median(ratios):.2f}")


class _Watched:
    """scipy.fft, with the time that its transforms take added up over the threads."""

    def __init__(self):
        self.seconds = 0.0

    def __getattr__(self, name):
        function = getattr(fft, name)
        if not name.endswith(("fft", "fft2")):
            return function

        def timed_function(*arguments, **named):
            begin = time.thread_time()
            result = function(*arguments, **named)
            self.seconds += time.thread_time() - begin
            return result

        return timed_function


def floor():
    """The engine's time over that of its FFTs alone, run on all cores."""
    print("time over that of the plan's FFTs alone")
    for name, image, window_um, options in (
            ("768 x 576, PSFs of 64 px, accuracy 0.03", checkerboard(), 64 * PITCH_UM, Options(accuracy=0.03)),
            ("768 x 576, PSFs of 64 px, the paper", checkerboard(), 64 * PITCH_UM, PAPER),
            ("3840 x 2160, accuracy 0.03", checkerboard(2160, 3840), None, Options(accuracy=0.03))):
        watched = _Watched()
        for module in (polar_sections, isoplanatic):
            module.fft = watched
        _, seconds, _ = timed(image, options, window_um, best_of=1)
        for module in (polar_sections, isoplanatic):
            module.fft = fft
        print(f"  {name}: {seconds / (watched.seconds / os.cpu_count()):.1f}")


def only_what_is_required():
    """Each saving on and off: seconds, and what it changes of the picture."""
    print("only what the scene requires: seconds without / with, and the relative L1 change")
    rows, columns = 1080, 1920
    dark = points(rows, columns, 297)
    dark_lit = replace(dark, cube=np.maximum(dark.cube, 1e-9))
    backdrop = np.ones((rows, columns))
    backdrop[400:600, 700:1100] = scene(200, 400)
    even = SpectralImage(backdrop, [NM], pitch_um=SENSOR_UM / columns)
    lamp = scene(rows, columns)
    lamp[rows // 2, columns // 2] = 1e6
    bright = SpectralImage(lamp, [NM], pitch_um=SENSOR_UM / columns)
    plain = SpectralImage(scene(rows, columns), [NM], pitch_um=SENSOR_UM / columns)
    same = replace(fresh_lens(), psf=np.broadcast_to(_round_psf(), (7, 21, 64, 64)))
    knobs = {"azimuths": 16, "section_size": 48}
    cases = (
        ("black sections", dark_lit, dark, Options(**knobs), Options(**knobs), None),
        ("flat sections", even, even, Options(**knobs), Options(**knobs, flat_tolerance=2e-3), None),
        ("PSF support, 0.999 of the light", bright, bright, Options(**knobs, psf_energy=1.0),
         Options(**knobs, psf_energy=0.999), None),
        ("precision by the range found", bright, bright, Options(**knobs, precision="float64"), Options(**knobs),
         None),
        ("symmetry of a centred axis", _off(bright), bright, Options(**knobs), Options(**knobs), None),
        ("one PSF: one convolution", plain, plain, Options(accuracy=0.01, method="sections"), Options(accuracy=0.01),
         same))
    for name, without, with_, options_without, options_with, lens in cases:
        took, results = [], []
        for image, options in ((without, options_without), (with_, options_with)):
            best = np.inf
            for _ in range(BEST_OF):
                used = replace(lens) if lens else fresh_lens()
                begin = time.perf_counter()
                result = simulate(image, used, options)
                best = min(best, time.perf_counter() - begin)
            took.append(best)
            results.append(result.cube.astype(float))
        change = np.abs(results[1] - results[0]).sum() / results[0].sum()
        print(f"  {name:<34}{took[0]:.3f} / {took[1]:.3f} = {took[0] / took[1]:.1f}, change {change:.1e}")


def _round_psf():
    offset = np.arange(64) - 32
    psf = np.exp(-(offset[:, None] ** 2 + offset**2) / (2 * 8**2))
    return psf / psf.sum()


def _off(image):
    """The same picture with its axis moved by a ten-thousandth of a pixel, so that nothing is symmetric any more."""
    row, column = image.centre_px
    return replace(image, grid=replace(image.grid, centre_px=(row + 1e-4, column)))


def main():
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, numpy {np.__version__}, "
          f"scipy {scipy.__version__}")
    for part in (small_frames, many_wavelengths, large_frames, flatness, animation, floor, only_what_is_required):
        part()


if __name__ == "__main__":
    if sys.argv[1:2] == ["--large-frame"]:
        large_frame([knob.split("=") for knob in sys.argv[2:]])
    else:
        main()
