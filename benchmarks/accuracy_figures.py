"""What the engine's accuracy costs and what each of its savings is worth, at length: half an hour beside bench.py.

    python benchmarks/accuracy_figures.py

Times are told as in bench.py. Accuracies are set against the paper's method in the same run: its sections of 16 px with
one PSF each, as it writes them, and such sections cut so small that they reach the same error. Errors are against the
exact operator, every pixel turning its own PSF; of many wavelengths against pixels with 512 azimuths.
"""

from dataclasses import replace

import numpy as np
from cases import NM, PAPER, PAPER_LENS, SENSOR_UM, checkerboard, multispectral, points
from timing import machine, quickest

from lensfield.engine import Lens, Options, SpectralImage
from lensfield.engine.trade.tradeoff import errors

PITCH_UM = SENSOR_UM / 768
ACCURACIES = 0.1, 0.03, 0.01, 0.003, 1e-3, 1e-4
ASKED = [(f"accuracy {accuracy:g}", Options(accuracy=accuracy)) for accuracy in ACCURACIES]
FINE = Options(azimuths=256, section_size=48)
NEARLY_EXACT = Options(method="pixels", azimuths=512, psf_energy=1.0, precision="float64")


def lens_of_window(window_um=None):
    """The paper's lens; its PSFs scaled to a window of this width, if any."""
    lens = Lens.load(PAPER_LENS)
    return replace(lens, psf_pitch_um=window_um / lens.psf.shape[-1]) if window_um else lens


def relative_l2(result, exact):
    return errors(result.cube, exact.cube)["relative_l2"]


class Frame:
    """The paper's frame at one wavelength, with PSFs of some size: what is exact for it, and the paper's method.

    `hard` are the paper's sections at several sizes: (seconds, relative L2 error of the points). Seconds are those of
    the checkerboard, where no section is black. Where the exact operator would take many minutes for it, 256 azimuths
    stand for that.
    """

    def __init__(self, name, window_um, board_exactly):
        self._lens = lens_of_window(window_um)
        print(name)
        self._exact, boards = {}, Options(method="exact") if board_exactly else FINE
        for picture, image, options in (("points", points(), Options(method="exact")),
                                        ("checkerboard", checkerboard(), boards)):
            run = quickest(image, self._lens, options, best_of=1)
            self._exact[picture] = run.irradiance
            print(f"  {picture}, {options.method}{' operator' if options.method == 'exact' else ', 256 azimuths'}: "
                  f"{run.processor_s:.1f} s", flush=True)
        self._paper_s, found, _ = self._measure(PAPER)
        print(f"  {'the paper as written':<24}{self._paper_s:8.3f} s  {errors_text(found)}", flush=True)
        self._hard = []
        for size in (16, 8, 4):
            seconds, found, _ = self._measure(Options(method="paper", section_size=size), best_of=1)
            self._hard.append((seconds, found["points"]))
            print(f"  {f'hard sections, {size} px':<24}{seconds:8.3f} s  {errors_text(found)}", flush=True)

    def _measure(self, options, best_of=3):
        """Seconds, relative L2 errors by picture, and the plan."""
        board, dots = (quickest(image, self._lens, options, best_of=runs)
                       for image, runs in ((checkerboard(), best_of), (points(), 1)))
        found = {picture: relative_l2(run.irradiance, self._exact[picture])
                 for picture, run in (("points", dots), ("checkerboard", board))}
        return board.processor_s, found, board.report.lens_image.plan

    def _hard_seconds(self, error):
        """Seconds of hard sections with this error: on the line, in log-log, through the two nearest."""
        (s0, e0), (s1, e1) = sorted(self._hard, key=lambda hard: abs(np.log(hard[1] / error)))[:2]
        return s0 * (error / e0) ** (np.log(s1 / s0) / np.log(e1 / e0))

    def tell(self, name, options):
        seconds, found, plan = self._measure(options)
        print(f"  {name:<24}{seconds:8.3f} s  {errors_text(found)}; the paper's time / this: "
              f"{self._paper_s / seconds:.1f}, at equal error {self._hard_seconds(found['points']) / seconds:.0f}; "
              f"{plan.text}", flush=True)


def errors_text(found):
    return ", ".join(f"{picture} {error:.1e}" for picture, error in found.items())


def small_frames():
    frame = Frame("768 x 576, 587.6 nm, windows of 18 px", None, board_exactly=True)
    for name, options in ASKED:
        frame.tell(name, options)
    frame = Frame("768 x 576, 587.6 nm, enlarged to windows of 64 px", 64 * PITCH_UM, board_exactly=False)
    for name, options in (*ASKED[:4], *((f"sections, {n} azimuths", Options(azimuths=n, section_size=96))
                                        for n in (3, 4, 6, 8))):
        frame.tell(name, options)


def many_wavelengths():
    image, lens = multispectral(), lens_of_window()
    exact = quickest(image, lens, NEARLY_EXACT, best_of=1).irradiance
    print(f"380 x 253, 31 wavelengths: the paper as written {quickest(image, lens, PAPER).processor_s:.2f} s")
    for name, options in ASKED[:5]:
        run = quickest(image, lens, options)
        print(f"  {name:<24}{run.processor_s:8.3f} s  relative L2 {relative_l2(run.irradiance, exact):.1e}; "
              f"{run.report.lens_image.plan.text}", flush=True)


def patches(rows, columns):
    """Patches and noise."""
    rng = np.random.default_rng(1)
    squares = rng.random((-(-rows // 24), -(-columns // 24)))
    return np.kron(squares, np.ones((24, 24)))[:rows, :columns] + 0.1 * rng.random((rows, columns))


def flatness():
    """Cost per pixel from 0.1 to 33 megapixels, with PSFs of the same size in pixels."""
    print("one wavelength, windows of 18 px, accuracy 0.01: microseconds per pixel")
    for rows, columns in ((253, 380), (576, 768), (1080, 1920), (2160, 3840), (4320, 7680)):
        image = SpectralImage(patches(rows, columns), [NM], pitch_um=SENSOR_UM / columns)
        run = quickest(image, lens_of_window(18 * image.pitch_um), Options(accuracy=0.01))
        print(f"  {rows * columns / 1e6:5.1f} megapixels: {run.processor_s / (rows * columns) * 1e6:.3f}; "
              f"{run.report.lens_image.plan.text}", flush=True)


def only_what_is_required():
    """Each saving on and off: seconds, and what it changes of the picture."""
    print("only what the scene requires: seconds without / with, and the relative L1 change")
    rows, columns = 1080, 1920
    dark = points(rows, columns, 297)
    dark_lit = replace(dark, cube=np.maximum(dark.cube, 1e-9))
    backdrop = np.ones((rows, columns))
    backdrop[400:600, 700:1100] = patches(200, 400)
    lamp = patches(rows, columns)
    lamp[rows // 2, columns // 2] = 1e6
    even, bright, plain = (SpectralImage(plane, [NM], pitch_um=SENSOR_UM / columns)
                           for plane in (backdrop, lamp, patches(rows, columns)))
    own = lens_of_window()
    same = replace(own, psf=np.broadcast_to(_round_psf(), (*own.psf.shape[:2], 64, 64)))
    knobs = {"azimuths": 16, "section_size": 48}
    for name, lens, without, with_, options_without, options_with in (
            ("black sections", own, dark_lit, dark, Options(**knobs), Options(**knobs)),
            ("flat sections", own, even, even, Options(**knobs), Options(**knobs, flat_tolerance=2e-3)),
            ("PSF support, 0.999 of the light", own, bright, bright, Options(**knobs, psf_energy=1.0),
             Options(**knobs, psf_energy=0.999)),
            ("precision by the range found", own, bright, bright, Options(**knobs, precision="float64"),
             Options(**knobs)),
            ("symmetry of a centred axis", own, _off(bright), bright, Options(**knobs), Options(**knobs)),
            ("one PSF: one convolution", same, plain, plain, Options(accuracy=0.01, method="sections"),
             Options(accuracy=0.01))):
        slow, quick = quickest(without, lens, options_without), quickest(with_, lens, options_with)
        change = errors(quick.irradiance.cube, slow.irradiance.cube)["l1"]
        print(f"  {name:<34}{slow.processor_s:.3f} / {quick.processor_s:.3f} = "
              f"{slow.processor_s / quick.processor_s:.1f}, change {change:.1e}", flush=True)


def _round_psf():
    offset = np.arange(64) - 32
    psf = np.exp(-(offset[:, None] ** 2 + offset**2) / (2 * 8**2))
    return psf / psf.sum()


def _off(image):
    """The same picture with its axis moved by a ten-thousandth of a pixel, so that nothing is symmetric any more."""
    row, column = image.centre_px
    return replace(image, grid=replace(image.grid, centre_px=(row + 1e-4, column)))


def main():
    print(machine())
    for part in (only_what_is_required, flatness, many_wavelengths, small_frames):
        part()


if __name__ == "__main__":
    main()
