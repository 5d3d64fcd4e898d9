"""The Cornell box with its measured spectra, against what Mitsuba 3 makes of it: validation/cornell_truth.py in small.

The figures in tests/data/cornell_mitsuba.npz are Mitsuba's, by `python validation/cornell_mitsuba.py`.
"""


import numpy as np
import pytest

import cornell_blender
import cornell_box as box
from places import DATA

MITSUBA = DATA / "cornell_mitsuba.npz"
SIDE_PX = 32
SAMPLES = 512


@pytest.fixture(scope="module")
def blocks(tmp_path_factory):
    """Radiance of 8 x 8 px blocks, (wavelength, row, column), by Lensfield and by Mitsuba."""
    with np.load(MITSUBA) as figures:
        wavelengths_nm, truth = figures["wavelengths_nm"], figures["radiance"]
    scene = cornell_blender.build(SIDE_PX, SAMPLES)
    cube = cornell_blender.render(scene, wavelengths_nm, tmp_path_factory.mktemp("cornell"))
    return box.block_means(cube, truth.shape[-1]), truth


def test_means_are_those_of_mitsuba(blocks):
    ours, truth = blocks
    np.testing.assert_allclose(ours.mean(axis=(1, 2)), truth.mean(axis=(1, 2)), rtol=3e-3)


def test_means_of_the_lower_half_where_no_lamp_is_seen_are_those_of_mitsuba(blocks):
    ours, truth = (side[:, side.shape[1] // 2:].mean(axis=(1, 2)) for side in blocks)
    np.testing.assert_allclose(ours, truth, rtol=3e-3)


def test_blocks_are_those_of_mitsuba(blocks):
    np.testing.assert_allclose(*blocks, rtol=0.03)


def test_lamp_seen_from_below_has_the_radiance_it_was_given(tmp_path):
    """By hand, without Mitsuba: the lamp's own radiance, and what it reflects of the box's light, which is little."""
    scene = cornell_blender.build(SIDE_PX, 16)
    cube = cornell_blender.render(scene, [450.0, 550.0, 650.0], tmp_path)
    emitted = box.lamp_radiance([450.0, 550.0, 650.0])
    np.testing.assert_allclose(emitted, [4.0, 11.8, 17.0])
    np.testing.assert_allclose(cube.max(axis=(1, 2)), emitted, rtol=0.02)
