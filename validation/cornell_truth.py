"""The Cornell box with its measured spectra, by Lensfield and by an independent renderer, Mitsuba 3.

    python validation/cornell_truth.py OUTPUT

Prints limits and measured figures, and writes both pictures side by side to OUTPUT/cornell_box.jpg. The exit status is
1 if a figure exceeds its limit. Three to six minutes on two cores.

Each renders 31 wavelengths twice, with different random numbers. The noise of the mean is half the difference of the
two renders.
"""

import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

import cornell_blender
import cornell_box as box
import cornell_mitsuba
from lensfield import addon
from lensfield.engine import SpectralImage
from lensfield.engine.pictures.preview import auto_exposure, to_rec709
from lensfield.engine.spectral.colour import encode_srgb

WAVELENGTHS_NM = np.linspace(400, 700, 31)
SIDE_PX, BLOCKS = 48, 6  # a block is 8 x 8 px
SAMPLES = 1024  # for each pixel, in each of the two renders; a square number, which Mitsuba's sampler prefers
SEEDS = 1, 2
MEAN_TOLERANCE, BLOCK_TOLERANCE = 0.003, 0.03
ENLARGED, GAP_PX = 7, 8


@dataclass(frozen=True, eq=False)
class Measured:
    """The mean of two renders, (wavelength, row, column), and the noise of its blocks relative to their radiance."""

    cube: np.ndarray
    block_noise: np.ndarray

    @classmethod
    def of(cls, first, second):
        means, other_means = box.block_means(first, BLOCKS), box.block_means(second, BLOCKS)
        return cls((first + second) / 2, relative(means, other_means) / 2)


def relative(value, truth):
    """Relative difference; at wavelengths without light, where both must be black, 0 or infinite."""
    dark = truth == 0
    return np.where(dark, np.where(value == 0, 0, np.inf), value / np.where(dark, 1, truth) - 1)


def by_lensfield(folder):
    addon.register()
    scene = cornell_blender.build(SIDE_PX, SAMPLES)
    return Measured.of(*(cornell_blender.render(scene, WAVELENGTHS_NM, folder, seed) for seed in SEEDS))


def by_mitsuba():
    return Measured.of(*(cornell_mitsuba.render(WAVELENGTHS_NM, SIDE_PX, SAMPLES, seed) for seed in SEEDS))


def compare(ours, truth):
    """Print the figures of each wavelength and of all together; returns whether all are within their tolerances."""
    def means(measured, first_row):
        return measured.cube[:, first_row:].mean(axis=(1, 2), dtype=np.float64)

    frame, lower_half = (relative(means(ours, row), means(truth, row)) for row in (0, SIDE_PX // 2))
    blocks = relative(box.block_means(ours.cube, BLOCKS), box.block_means(truth.cube, BLOCKS))
    print("  nm   radiance, W m^-2 sr^-1 nm^-1   Lensfield / Mitsuba - 1, %")
    print("       Lensfield   Mitsuba            frame   lower half   worst 8x8 block")
    for row in zip(WAVELENGTHS_NM, means(ours, 0), means(truth, 0), 100 * frame, 100 * lower_half,
                   100 * np.abs(blocks).max(axis=(1, 2)), strict=True):
        print("{:5.0f}   {:.6f}   {:.6f}         {:+7.3f}   {:+7.3f}       {:6.2f}".format(*row))
    noise = [rms(measured.block_noise) for measured in (ours, truth)]
    print(f"8x8 blocks: differences {100 * rms(blocks):.2f} % RMS; noise {100 * noise[0]:.2f} % (Lensfield) and "
          f"{100 * noise[1]:.2f} % (Mitsuba), together {100 * np.hypot(*noise):.2f} %")
    return all([met("means of the frame", frame, MEAN_TOLERANCE),
                met("means of its lower half, without the lamp", lower_half, MEAN_TOLERANCE),
                met("8x8 blocks", blocks, BLOCK_TOLERANCE)])


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def met(what, differences, tolerance):
    """Print the limit and the measured figure; returns whether the limit is met."""
    worst = np.abs(differences).max()
    print(f"{what}: limit {100 * tolerance:g} %, measured {100 * worst:.3f} % at worst"
          f"{'' if worst <= tolerance else '   MISSED'}")
    return worst <= tolerance


def write_picture(cubes, path):
    """Write the cubes side by side in colour, with the same exposure."""
    linear = [to_rec709(SpectralImage(cube, WAVELENGTHS_NM, pitch_um=1)) for cube in cubes]
    exposure = auto_exposure(linear[0][SIDE_PX // 2:])  # for the floor, not the lamp
    large = [np.kron(encode_srgb(picture * exposure), np.ones((ENLARGED, ENLARGED, 1))) for picture in linear]
    gap = np.ones((len(large[0]), GAP_PX, 3))
    sheet = np.concatenate([large[0], gap, large[1]], axis=1)
    Image.fromarray(np.round(255 * sheet).astype(np.uint8)).save(path, quality=88, optimize=True)


def main(output):
    output.mkdir(parents=True, exist_ok=True)
    truth = by_mitsuba()
    with tempfile.TemporaryDirectory() as folder:
        ours = by_lensfield(folder)
    write_picture((ours.cube, truth.cube), output / "cornell_box.jpg")
    return 0 if compare(ours, truth) else 1


if __name__ == "__main__":
    status = main(Path(sys.argv[1]))
    sys.stdout.flush()
    os._exit(status)  # some of Blender's wheels crash while the interpreter exits
