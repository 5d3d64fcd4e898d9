"""Stray light of an animation: it follows a moving lamp evenly, and is the same in every run."""

import numpy as np

from lensfield.engine import Rings, load_lens
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.spectral_image import SpectralImage
from lensfield.engine.lens.iris import Iris
from lensfield.engine.stray.options import StrayOptions
from lensfield.engine.stray.stray_light import stray_light

GRID = PixelGrid((90, 140), 100.0, centre_px=(40.0, 75.0), overscan_px=(4, 6))
LAMP_SHARE, FRAMES, STEP_PX = 0.4, 8, (0.3, 0.75)


def lamp_over_a_ground(row, column):
    rows, columns = np.ogrid[:GRID.shape_px[0], :GRID.shape_px[1]]
    lamp = np.exp(-((rows - row)**2 + (columns - column)**2) / 2)
    ground = np.where(rows < 50, 1.0, 0.3) * np.ones(GRID.shape_px)
    return ground + lamp * ground.sum() / lamp.sum() * LAMP_SHARE / (1 - LAMP_SHARE)


def test_stray_light_follows_a_lamp_evenly():
    lens = load_lens("cooke-triplet-50mm", Rings(f_number=5.6, coating="none"))

    def frame(number, part):
        plane = lamp_over_a_ground(*(start + number * step for start, step in zip((46, 70), STEP_PX, strict=True)))
        image = SpectralImage(np.stack([plane, 2 * plane]), (500.0, 600.0), GRID)
        return stray_light(image, lens, StrayOptions(part), 0.01, iris=Iris(5)).cube

    for part, unevenness in (("ghosts", 0.003), ("veil", 0.003), ("star", 0.02)):
        frames = np.array([frame(number, part) for number in range(FRAMES)])
        light = frames.sum(axis=(2, 3))
        changes = np.abs(np.diff(frames, axis=0)).sum(axis=(2, 3)) / light[1:]
        assert np.abs(np.diff(light / light.mean(axis=0), 2, axis=0)).max() < unevenness
        assert np.abs(np.diff(changes, axis=0)).max() < 0.3 * np.median(changes)
        np.testing.assert_array_equal(frame(3, part), frames[3])
