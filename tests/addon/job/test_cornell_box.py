"""The Cornell box with its measured spectra, against Mitsuba 3: a small version of validation/cornell_truth.py.

The figures in tests/data/cornell_mitsuba.npz are from Mitsuba, by `python validation/cornell_mitsuba.py`.
"""

import numpy as np

import cornell_blender
import cornell_box as box
from noise import assert_means
from places import DATA

MITSUBA = DATA / "cornell_mitsuba.npz"
SIDE_PX = 32
SAMPLES = 768  # for each of two seeds


def pictures(folder):
    """Radiance by Lensfield with two seeds, and the means of its blocks by Mitsuba.

    Lensfield's has Mitsuba's blocks: array (seed, wavelength, block row, block column, row, column).
    """
    with np.load(MITSUBA) as figures:
        wavelengths_nm, truth = figures["wavelengths_nm"], figures["radiance"]
    scene = cornell_blender.build(SIDE_PX, SAMPLES)
    first = scene.cycles.seed
    cubes = np.stack([cornell_blender.render(scene, wavelengths_nm, folder, seed) for seed in (first, first + 1)])
    side = SIDE_PX // truth.shape[-1]
    blocks = cubes.reshape(2, len(truth), truth.shape[1], side, truth.shape[2], side).astype(np.float64)
    return blocks.swapaxes(3, 4), truth


def all_pixels(blocks):
    """The pixels of all blocks in one array; blocks have the same size."""
    return blocks.reshape(*blocks.shape[:2], 1, -1)


def test_means_and_blocks_agree_with_mitsuba(tmp_path):
    """Also in the lower half, which does not show the lamp."""
    blocks, truth = pictures(tmp_path)
    lower = truth.shape[1] // 2
    for shown, expected, noise in ((blocks, truth, 5e-3), (blocks[:, :, lower:], truth[:, lower:], 0.01)):
        first, second = all_pixels(shown)
        assert_means(first, expected.mean(axis=(1, 2)), 3e-3, noise=noise, other_seed=second)
    first, second = blocks
    assert_means(first, truth, 0.01, noise=0.1, other_seed=second)


def test_the_lamp_has_its_specified_radiance_from_below(tmp_path):
    """By hand, without Mitsuba: the lamp's own radiance, plus the small part of the box's light that it reflects."""
    scene = cornell_blender.build(SIDE_PX, 16)
    cube = cornell_blender.render(scene, [450.0, 550.0, 650.0], tmp_path, scene.cycles.seed)
    emitted = box.lamp_radiance([450.0, 550.0, 650.0])
    np.testing.assert_allclose(emitted, [4.0, 11.8, 17.0])
    np.testing.assert_allclose(cube.max(axis=(1, 2)), emitted, rtol=0.02)
