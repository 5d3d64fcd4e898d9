"""Simulated flat fields and dark frames of five sensors, evaluated by emva1288, the EMVA 1288 reference implementation.

    python validation/sensor_emva.py [PAGE.md PLOT.png]

takes the pictures with `expose` in monochromatic light, gives them to the evaluator as files, and prints each figure of
the standard next to the camera's own. The exit status is 1 if one is outside its confidence interval, or if repetitions
scatter more or less than the intervals state. The table in the page is replaced, and the photon transfer curves drawn.
"""

import logging
import re
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.constants import c, h

from lensfield.engine import SpectralImage
from lensfield.engine.inspection.axes import Axis, Panel, labels_of
from lensfield.engine.inspection.canvas import Box, Page, Pen
from lensfield.engine.library.bodies import load_camera
from lensfield.engine.sensor.camera import Camera
from lensfield.engine.sensor.exposure import Exposure, expose
from lensfield.engine.sensor.metering import full_scale_e

SENSORS = (("generic-phone-48", 50.0), ("generic-three-chip", 400.0), ("fujifilm-x-t4", 160.0), ("sony-a7-iii", 800.0),
           ("generic-cinema", 400.0))
"""Cameras, by size of their pixels, and ISOs."""
CHANNEL = "G"  # the channel whose pixels are evaluated
SHUTTER_S = 1e-3
SIGMAS = 5
FITTED = 0.7  # of saturation: the standard's limit for its linear fits
NS_PER_S = 1e9
COLOURS = "#000000", "#E69F00", "#009E73", "#0072B2", "#D55E00"
MARKERS = "circle", "square", "diamond", "up", "down"
TABLE = re.compile(r"(## Judged by EMVA 1288\n.*?\n)(\|.*?)(?=\n\n)", re.DOTALL)


@dataclass(frozen=True)
class Series:
    """How much is measured: pixels, levels of light, frames for the differences between pixels, times in the dark."""

    frame_px: tuple[int, int] = (480, 640)
    levels: int = 50
    frames: int = 50
    times: int = 6
    seed: int = 0


QUICK = Series((120, 160), levels=30, frames=16, times=4)
REPETITIONS, MOST_SCATTER = 40, 0.5  # 5 standard deviations of a standard deviation from 40 values are 0.56
FIGURES = {"K": ("DN/e⁻", 4), "QE": ("%", 2), "σ_d": ("e⁻", 3), "DSNU1288": ("e⁻", 3), "PRNU1288": ("%", 3),
           "μ_I": ("e⁻/s", 4), "μ_e.sat": ("e⁻", 0)}
"""Units of the standard's figures, and decimals to print."""


@dataclass(frozen=True)
class Figure:
    """A figure of the standard: the camera's own, the interval of its evaluation, and its evaluation."""

    name: str
    camera: float
    low: float
    high: float
    evaluated: float

    @property
    def missed(self):
        return not self.low <= self.evaluated <= self.high

    def __str__(self):
        camera, evaluated, low, high = self._numbers
        return (f"  {self.name:10} camera {camera:>7} {FIGURES[self.name][0]:6} evaluated {evaluated:>7}   "
                f"interval {low} to {high}   {'MISSED' if self.missed else 'met'}")

    @property
    def cell(self):
        """The camera's own figure, the evaluated one, and its interval."""
        camera, evaluated, low, high = self._numbers
        return f"{camera}: **{evaluated}**<br>{low} to {high}"

    @property
    def _numbers(self):
        digits = FIGURES[self.name][1]
        return [f"{value:.{digits}f}" for value in (self.camera, self.evaluated, self.low, self.high)]


class Bench:
    """A camera in front of even light of one wavelength, at which the channel's quantum efficiency is highest."""

    def __init__(self, camera: Camera, iso: float, series: Series):
        self.camera, self.iso, self.series, self.frame = camera, iso, series, 0
        self.index = camera.channels.index(CHANNEL)
        peak = np.argmax(camera.quantum_efficiency[self.index])
        self.nm, self.efficiency = camera.wavelengths_nm[peak], camera.quantum_efficiency[self.index, peak]
        self.gain, self.capacity_e = camera.gain_at(iso), full_scale_e(camera, iso)
        self.pixels = self.shot(0.0).size

    def shot(self, photons, shutter_s=SHUTTER_S):
        """The channel's digital numbers, after so many photons on each pixel: array (row, column)."""
        joules = photons * h * c / (self.nm * 1e-9)
        irradiance = joules / ((self.camera.pitch_um * 1e-6)**2 * shutter_s)
        light = SpectralImage(np.full(self.series.frame_px, irradiance), [self.nm], pitch_um=self.camera.pitch_um,
                              quantity="irradiance")
        seed = self.series.seed
        raw = expose(light, self.camera, Exposure(shutter_s, self.iso, seed, self.frame, serial=seed))
        self.frame += 1
        chosen = raw.numbers[self.index] if raw.channel is None else raw.numbers[raw.channel == self.index]
        rows = self.series.frame_px[0]
        return chosen.ravel()[:chosen.size // rows * rows].reshape(rows, -1)

    @property
    def dark_variance_dn(self):
        """Temporal variance of the dark signal, with quantisation."""
        dark_e2 = self.camera.dark_noise_at(self.iso)**2 + self.camera.dark_current_e_per_s * SHUTTER_S
        return self.gain**2 * dark_e2 + 1 / 12

    def levels_e(self):
        """Mean electrons of the series: from few to beyond saturation, close to each other there."""
        count = self.series.levels
        spread = np.sqrt(1 / self.capacity_e + self.camera.prnu**2)
        close = np.linspace(1 - 8 * spread, 1 + 1.5 * spread, count * 2 // 5)
        even = np.linspace(0.03, 0.95 * close[0], count * 2 // 5)
        few = np.geomspace(2e-3, 0.025, count - len(close) - len(even))
        return self.capacity_e * np.concatenate([few, even, close])


def evaluate(bench):
    """The evaluator's results of a series of photons, and its figures by name."""
    photons, times = (_results(bench, series) for series in (_photon_series, _time_series))
    values = photons.K, photons.QE, photons.sigma_d, photons.DSNU1288, photons.PRNU1288
    return photons, dict(zip(FIGURES, (*values, times.u_I_mean_DN / photons.K, photons.u_e_sat), strict=True))


def _results(bench, series):
    """The evaluator's results of the pictures that a series writes."""
    from emva1288.process.data import Data1288
    from emva1288.process.loader import LoadImageData
    from emva1288.process.parser import ParseEmvaDescriptorFile
    from emva1288.process.results import Results1288

    with tempfile.TemporaryDirectory() as folder:
        descriptor = Path(folder, "descriptor.txt")
        descriptor.write_text("\n".join(series(Path(folder), bench)) + "\n")
        images = ParseEmvaDescriptorFile(str(descriptor), loglevel=logging.WARNING).images
        data = Data1288(LoadImageData(images, loglevel=logging.WARNING).data, loglevel=logging.WARNING)
    return Results1288(data.data, loglevel=logging.WARNING)


def _photon_series(folder, bench):
    """Write pairs of frames at all levels, and many frames in the dark and at half of saturation: the lines of the file
    that describes them.
    """
    series, photons = bench.series, bench.levels_e() / bench.efficiency
    yield f"n {bench.camera.bits} {series.frame_px[1]} {series.frame_px[0]}"
    for level in (0.0, *photons):
        yield from _frames(folder, bench, level, 2)
    for level in (0.0, bench.capacity_e / bench.efficiency / 2):
        yield from _frames(folder, bench, level, series.frames)


def _time_series(folder, bench):
    """Write pairs of frames in the dark after different times, with one of light and the frames that the evaluator
    requires: the lines of the file that describes them.
    """
    yield f"n {bench.camera.bits} {bench.series.frame_px[1]} {bench.series.frame_px[0]}"
    photons = bench.capacity_e / bench.efficiency / 2
    for shutter_s in times_s(bench):
        for level in (0.0, photons):
            yield from _frames(folder, bench, level, 2, shutter_s)
    for level in (0.0, photons):
        yield from _frames(folder, bench, level, 3)


def times_s(bench):
    """Exposure times in which up to 100 electrons of dark current collect."""
    return 100 / bench.camera.dark_current_e_per_s * np.linspace(0.05, 1, bench.series.times)


def _frames(folder, bench, photons, number, shutter_s=SHUTTER_S):
    time_ns = f"{shutter_s * NS_PER_S:.3f}"
    yield f"b {time_ns} {photons!r}" if photons else f"d {time_ns}"
    for _ in range(number):
        path = folder / f"{bench.frame}.tif"
        Image.fromarray(bench.shot(photons, shutter_s)).save(path)
        yield f"i {path.name}"


def intervals(bench):
    """The camera's own figures by name, each with the ends of the interval for its evaluation.

    Except for saturation they are `SIGMAS` standard deviations of the estimator to both sides. n pixels in a pair of
    frames give a temporal variance v with the variance 2 v^2 / n, and a mean with v / (2 n). K and the responsivity R
    are slopes through 0, so their variances are sums over the levels; QE = R / K. The mean over L frames has the
    variance w = s^2 + v / L between pixels, with the variance 2 w^2 / n; s is DSNU or PRNU.
    """
    camera, gain, dark = bench.camera, bench.gain, bench.dark_variance_dn
    of_gain, of_efficiency, by_dark = _slope_errors(bench)
    of_dsnu, of_prnu = _spatial_errors(bench)
    sigma_d, current = np.sqrt(dark - 1 / 12) / gain, camera.dark_current_e_per_s
    alone = 1 / (2 * gain**2 * sigma_d)  # d sigma_d / d dark, to which K adds sigma_d by_dark
    of_sigma_d = np.hypot(np.sqrt(2 / bench.pixels * (alone**2 + 2 * alone * sigma_d * by_dark)) * dark,
                          sigma_d * of_gain)
    by_sigma = ((gain, gain * of_gain),
                (100 * bench.efficiency, 100 * bench.efficiency * of_efficiency),
                (sigma_d, of_sigma_d),
                (camera.dsnu_e, np.hypot(of_dsnu, camera.dsnu_e * of_gain)),
                (100 * camera.prnu, 100 * of_prnu),
                (current, np.hypot(_dark_slope_error(bench), current * of_gain)))
    ends = [(own, own - SIGMAS * sigma, own + SIGMAS * sigma) for own, sigma in by_sigma]
    return dict(zip(FIGURES, (*ends, (bench.capacity_e, *_saturation_interval_e(bench))), strict=True))


def figures(bench, values):
    """The figures with these evaluations, by name."""
    return [Figure(name, *ends, values[name]) for name, ends in intervals(bench).items()]


def _slope_errors(bench):
    """Relative standard deviations of K and QE, and the relative decrease of K by a higher variance in the dark."""
    signal = bench.gain * bench.levels_e()
    signal = signal[signal <= FITTED * bench.gain * bench.capacity_e]
    dark, squares = bench.dark_variance_dn, (signal**2).sum()
    variances = dark + bench.gain * signal
    of_gain = np.sqrt((signal**2 * 2 * variances**2).sum() + signal.sum()**2 * 2 * dark**2) / squares / bench.gain
    of_response = np.sqrt((signal**2 * variances / 2).sum() + signal.sum()**2 * dark / 2) / squares
    of_response = np.hypot(of_response, bench.camera.prnu)  # the mean of the pixels' own
    of_gain, of_efficiency = np.array([of_gain, np.hypot(of_gain, of_response)]) / np.sqrt(bench.pixels)
    return of_gain, of_efficiency, signal.sum() / squares / bench.gain


def _spatial_errors(bench):
    """Standard deviations of DSNU in electrons, and of PRNU."""
    camera, frames, half_e = bench.camera, bench.series.frames, bench.capacity_e / 2
    dark_e2 = bench.dark_variance_dn / bench.gain**2
    in_dark = camera.dsnu_e**2 + dark_e2 / frames
    in_light = in_dark + (camera.prnu * half_e)**2 + half_e / frames
    of_dark = np.sqrt(2 * in_dark**2 + 2 * dark_e2**2 / frames**3)
    of_difference = np.sqrt(2 * (in_light**2 + in_dark**2 - 2 * camera.dsnu_e**4)
                            + 2 * ((dark_e2 + half_e)**2 + dark_e2**2) / frames**3)
    return (of_dark / (2 * camera.dsnu_e) / np.sqrt(bench.pixels),
            of_difference / (2 * camera.prnu * half_e**2) / np.sqrt(bench.pixels))


def _dark_slope_error(bench):
    """Standard deviation of the slope of the dark signal over time, in electrons per second."""
    about_s = times_s(bench) - times_s(bench).mean()
    variances = bench.dark_variance_dn / bench.gain**2 + bench.camera.dark_current_e_per_s * times_s(bench)
    return np.sqrt((about_s**2 * variances).sum() / (2 * bench.pixels)) / (about_s**2).sum()


def _saturation_interval_e(bench):
    """Electrons of the levels that can have the highest temporal variance, which is the standard's saturation.

    Pixels that a part of the frames saturates fluctuate less. The variance therefore falls before the mean saturates. A
    level can win by noise if its variance is less than 5 standard deviations of a difference, 2 v / sqrt(n), below the
    highest; and the place between two levels is unknown.
    """
    levels_e, variances = bench.levels_e(), _expected_variances_e2(bench)
    near = np.flatnonzero(variances > variances.max() * (1 - SIGMAS * 2 / np.sqrt(bench.pixels)))
    return levels_e[max(near[0] - 1, 0)], levels_e[min(near[-1] + 1, len(levels_e) - 1)]


def _expected_variances_e2(bench):
    """Temporal variances of the levels: means over pixels of the variance of clipped electrons with noise."""
    camera, steps = bench.camera, np.linspace(-6, 6, 241)
    share = np.exp(-steps**2 / 2) / np.exp(-steps**2 / 2).sum()
    mean_e = bench.levels_e()[:, None] * (1 + camera.prnu * steps)
    drawn_e = np.minimum(mean_e[..., None] + np.sqrt(mean_e)[..., None] * steps, bench.capacity_e)
    variance = (drawn_e**2) @ share - (drawn_e @ share)**2
    return variance @ share + bench.dark_variance_dn / bench.gain**2


def table(measured):
    """Markdown of the figures: a row for each figure, a column for each camera."""
    rows = [["", *(f"{bench.camera.name}, ISO {bench.iso:g}" for bench, _, _ in measured)],
            ["---"] * (len(measured) + 1),
            *([f"{same[0].name}, {FIGURES[same[0].name][0]}", *(figure.cell for figure in same)]
              for same in zip(*(judged for _, judged, _ in measured), strict=True))]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def write_plot(measured, path):
    """Draw temporal variance over signal, and the ratio of signal to noise over light, measured and expected."""
    page, names = Page(9, 4, 110), [f"{bench.camera.name}, ISO {bench.iso:g}" for bench, *_ in measured]
    pens = [Pen(colour, 0.8, marker=marker, marker_pt=3.5) for colour, marker in zip(COLOURS, MARKERS, strict=True)]
    left, right = zip(*(_curves(bench, results) for bench, _, results in measured), strict=True)
    _draw(page, Box(0.7, 0.5, 3.7, 3.4), left, pens, "signal without dark signal (DN)", "temporal variance (DN²)")
    panel = _draw(page, Box(5.15, 0.5, 3.7, 3.4), right, pens, "photons per µm²", "signal-to-noise ratio")
    panel.legend([(name, replace(pen, width_pt=0)) for name, pen in zip(names, pens, strict=True)], 7.5)
    Image.fromarray(page.pixels()).save(path)


def _curves(bench, results):
    """Variance over signal, and ratio over light: of each, measured x and y, and expected x and y."""
    temporal, area_um2 = results.temporal, bench.camera.pitch_um**2
    signal, variance = temporal["u_y"] - temporal["u_ydark"], temporal["s2_y"]
    model = bench.gain * bench.levels_e()
    expected = bench.dark_variance_dn + bench.gain * model
    return ((signal, variance, model, expected),
            (temporal["u_p"] / area_um2, signal / np.sqrt(variance),
             model / (bench.gain * bench.efficiency * area_um2), model / np.sqrt(expected)))


def _draw(page, place, curves, pens, across, up):
    """Draw measured points and expected lines of each camera on logarithmic axes, and return the panel."""
    x, y = (np.concatenate([np.ravel(part) for curve in curves for part in curve[axis::2]]) for axis in (0, 1))
    panel = Panel(page, place, Axis.around(x, 0.05, log=True), Axis.around(y, 0.05, log=True))
    x_ticks, y_ticks = panel.x.ticks(5), panel.y.ticks(5)
    panel.dress(x_ticks, labels_of(x_ticks), y_ticks, labels_of(y_ticks), 8)
    panel.name_axes(across, up, 9)
    for (x, y, model_x, model_y), pen in zip(curves, pens, strict=True):
        panel.curve(x, y, replace(pen, width_pt=0))
        panel.curve(model_x, model_y, replace(pen, marker=""))
    return panel


def measure(name, iso, series):
    """The bench of a camera, its figures, and the evaluator's results."""
    bench = Bench(load_camera(name), iso, series)
    results, values = evaluate(bench)
    return bench, figures(bench, values), results


def scatter(name, iso):
    """Standard deviation of each evaluation, except of saturation, over the expected, from repetitions."""
    repeated = [measure(name, iso, replace(QUICK, seed=seed))[1][:-1] for seed in range(REPETITIONS)]
    deviations = [[SIGMAS * (each.evaluated - each.camera) / (each.high - each.camera) for each in judged]
                  for judged in repeated]
    return dict(zip(FIGURES, np.std(deviations, axis=0), strict=False))


def main(arguments):
    measured = []
    for name, iso in SENSORS:
        measured.append(measure(name, iso, Series()))
        bench, judged, _ = measured[-1]
        print(f"\n{bench.camera.title}, {CHANNEL} at {bench.nm:g} nm, ISO {iso:g}: {bench.pixels} pixels")
        print(*judged, sep="\n", flush=True)
    scattered = scatter(*SENSORS[0])
    print("\nscatter over the expected:", *(f"{name} {value:.2f}" for name, value in scattered.items()))
    if arguments:
        page, plot = map(Path, arguments)
        text = TABLE.sub(lambda match: match[1] + table(measured), page.read_text(encoding="utf-8"))
        page.write_text(text, encoding="utf-8")
        write_plot(measured, plot)
    return int(any(figure.missed for _, judged, _ in measured for figure in judged)
               or any(abs(value - 1) > MOST_SCATTER for value in scattered.values()))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
