"""The sample scene rendered by Lensfield and by the traced lens, at one wavelength: the cost of equal noise.

    python validation/against_traced_lens.py [PICTURE.png]

The noise of a patch is the RMS difference of two seeds over the square root of 2, relative to the patch's mean. It is
measured for pixels and for means of blocks, because Lensfield blurs the noise of its radiance along with the picture.
Each is measured at two numbers of samples, near the noise at which they are compared. Between them, noise is
interpolated as a power of the samples, with an exponent near -1/2, and seconds linearly. Processor seconds are summed
over all cores, and other load on the machine hardly changes them.
"""

import platform
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

import truth_scenes
from lensfield import addon
from lensfield.engine import Options
from lensfield.engine.pictures.preview import write_png
from traced_lens import photograph
from traced_lens_truth import WAVELENGTH_NM, Bench, frame_of, full_frame, patches_about, spot

BLEND = Path(__file__).resolve().parents[1] / "sample_scenes" / "evening_chess.blend"
COLUMNS = 192
SAMPLES = {"Lensfield": (32, 96), "traced lens": (192, 384)}
NOISE = {1: 0.04, 4: 0.015}
"""The noise at which they are compared, by the side in pixels of the square blocks."""
PATCHES = {"chess board, before the object plane": (slice(122, 142), slice(74, 142)),
           "colour chart, in the object plane": (slice(74, 96), slice(122, 158))}
"""Rows and columns of 144 x 192."""
DEPTHS_MM = 125, 180, 250, 400, 1000


@dataclass(frozen=True, eq=False)
class Costs:
    """Processor seconds and wall-clock seconds: arrays (samples,); noise: array (samples, patch, block)."""

    samples: tuple[int, int]
    processor_s: np.ndarray
    clock_s: np.ndarray
    noise: np.ndarray
    picture: np.ndarray

    def samples_for(self, noise):
        """Number of samples at which each patch has the noise for each block size."""
        few, many = self.samples
        return few * (many / few) ** (np.log(self.noise[0] / noise) / np.log(self.noise[0] / self.noise[1]))

    def seconds_for(self, samples):
        """Processor seconds of a number of samples."""
        few, many = self.samples
        return self.processor_s[0] + (samples - few) * (self.processor_s[1] - self.processor_s[0]) / (many - few)


def measure(take, samples):
    """Costs of a function (samples, seed) -> picture, seconds."""
    take(1, 0)  # fills the caches
    seconds, noise = [], []
    for number in samples:
        (first, took), (second, took_again) = (take(number, seed) for seed in (0, 1))
        seconds.append((took + took_again) / 2)
        noise.append([[noise_of(first[patch], second[patch], side) for side in NOISE] for patch in PATCHES.values()])
    return Costs(samples, *np.transpose(seconds), np.array(noise), (first + second) / 2)


def noise_of(first, second, side_px):
    """RMS noise of the means of blocks, from two pictures, relative to the picture's mean."""
    rows, columns = (n // side_px for n in first.shape)
    apart = (first - second)[:rows * side_px, :columns * side_px].reshape(rows, side_px, columns, side_px)
    return np.sqrt(np.mean(apart.mean(axis=(1, 3)) ** 2) / 2) / first.mean()


def compare(bench, scene):
    """Measure the Costs of Lensfield and of the traced lens."""
    frame_px = full_frame(bench.lens, COLUMNS).shape_px

    def lensfield(samples, seed):
        scene.cycles.seed = seed
        started = np.array([time.process_time(), time.perf_counter()])
        picture = bench.lensfield(scene, frame_px, samples, Options())
        return picture, np.array([time.process_time(), time.perf_counter()]) - started

    def traced(samples, seed):
        return photograph(scene, bench.lens, WAVELENGTH_NM, frame_px, samples=samples, seed=seed)

    return measure(lensfield, SAMPLES["Lensfield"]), measure(traced, SAMPLES["traced lens"])


def print_comparison(ours, traced):
    for name, costs in zip(SAMPLES, (ours, traced), strict=True):
        for number, samples in enumerate(costs.samples):
            noise = ", ".join(f"{part:.2%}" for part in costs.noise[number].ravel())
            print(f"{name}, {samples} samples: {costs.processor_s[number]:.2f} processor s, "
                  f"{costs.clock_s[number]:.2f} s by the clock; noise {noise}")
    noise = np.array(list(NOISE.values()))
    pairs = np.stack([ours.samples_for(noise), traced.samples_for(noise)])
    for patch, of_patch in enumerate(PATCHES):
        for block, (side, noise) in enumerate(NOISE.items()):
            samples = pairs[:, patch, block]
            seconds = ours.seconds_for(samples[0]), traced.seconds_for(samples[1])
            print(f"  {of_patch}, {noise:.1%} of noise in {side} x {side} px: Lensfield {samples[0]:.0f} samples and "
                  f"{seconds[0]:.1f} processor s; traced {samples[1]:.0f} and {seconds[1]:.1f} s; "
                  f"{samples[1] / samples[0]:.1f} times the samples, {seconds[1] / seconds[0]:.1f} the seconds")


def print_depths(bench, frame_px=(49, 768), half_px=24, samples=256):
    """Print the RMS radius of the image of a point on the axis at several distances, by Lensfield and traced."""
    frame = frame_of(bench.lens, frame_px)
    patch, = patches_about([(0, 0)], frame, half_px)
    for depth_mm in DEPTHS_MM:
        scene = truth_scenes.empty_scene()
        truth_scenes.add_beads(scene, bench.lens, np.zeros((1, 2)), frame.pitch_um / 2,
                               depth_mm + bench.lens.entrance_pupil_mm)
        pictures = (bench.lensfield(scene, frame_px, samples, depth="auto")[patch],
                    bench.traced(scene, frame_px, samples, part=patch))
        ours, true = (spot(picture, frame, patch, half_px * frame.pitch_um).rms_um for picture in pictures)
        print(f"  a point {depth_mm:g} mm away: RMS radius {ours:.1f} um by Lensfield, {true:.1f} um traced")


def write_picture(pictures, path):
    """Write the pictures side by side, with the same exposure."""
    gap = np.ones((len(pictures[0]), 4)) * pictures[0].max()
    grey = np.hstack([pictures[0], gap, *pictures[1:]])
    write_png(np.repeat(grey[..., None], 3, axis=-1), path, 1 / np.percentile(pictures[0], 97))


def main(arguments):
    addon.register()
    bench = Bench("edmund-54852")
    print(f"{platform.machine()}, Python {platform.python_version()}, Blender {bpy.app.version_string}, {COLUMNS} "
          f"columns, {WAVELENGTH_NM:g} nm; patches: {', '.join(PATCHES)}")
    bpy.ops.wm.open_mainfile(filepath=str(BLEND))
    ours, traced = compare(bench, bpy.context.scene)
    print_comparison(ours, traced)
    if arguments:
        write_picture([ours.picture, traced.picture], Path(arguments[0]))
    print_depths(bench)


if __name__ == "__main__":
    main(sys.argv[1:])
