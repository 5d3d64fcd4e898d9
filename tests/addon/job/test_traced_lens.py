"""The complete chain against rays through the real lens, small; `make validate` has the figures.

The limits are from `validation/traced_lens_truth.py`, plus 5 sigma of the noise from fewer samples.
"""

from dataclasses import replace

import numpy as np
import pytest

import cycles_pictures
import traced_lens_truth as truth
import truth_scenes
from lensfield.addon.scene.traced_camera import shader_text, use_shader
from lensfield.addon.scene.undo import Journal
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.rays.from_sensor import FromSensor
from lensfield.engine.rays.sensor_aim import Bins
from noise import SIGMAS, assert_means, five_sigma
from traced_lens import photograph


class Bench(truth.Bench):
    """Traces each picture with two seeds.

    It returns their mean, and records half their difference, which is the mean's noise.
    """

    def traced(self, scene, shape_px, samples, seed=0, part=None):
        first, second = (super(Bench, self).traced(scene, shape_px, samples, 2 * seed + half, part) for half in (0, 1))
        self.frame, self.part = truth.frame_of(self.lens, shape_px), part
        self.picture, self.noise = (first + second) / 2, (first - second) / 2
        return self.picture


@pytest.fixture(scope="module")
def edmund():
    return Bench("edmund-54852")


@pytest.fixture(scope="module")
def petzval():
    return Bench("kodak-petzval-100mm", "preview")


@pytest.fixture(scope="module")
def reflex():
    return Bench("nikkor-reflex-500mm", "preview")


def values(figures, start):
    matching = [figure.value for figure in figures if figure.what.startswith(start)]
    assert matching
    return matching


def test_a_bare_hole_gives_the_irradiance_of_a_cone(tmp_path):
    radius_mm, distance_mm, one = 2.0, 5.0, np.ones(1)
    hole = FromSensor(distance_mm * one, 0 * one, 0 * one, np.zeros((1, 0)), 2, 2, radius_mm * one, 0 * one, one,
                      0 * one, 1.0, 0.0, Bins(1.0, 0.0, -radius_mm * one, radius_mm * one, radius_mm * one),
                      np.zeros(2))
    scene = truth_scenes.empty_scene()
    truth_scenes.set_even_light(scene, 1.0)
    use_shader(scene.camera.data, shader_text(hole, PixelGrid((8, 8), 1.0), 1e3), Journal())
    pictures = cycles_pictures.picture(scene, tmp_path, samples=8192)
    assert_means(pictures, np.full(3, np.pi * radius_mm**2 / (radius_mm**2 + distance_mm**2)), 1e-3)  # pi sin^2


def test_a_parabola_is_the_same_lens_as_a_conic_or_as_a_term_in_r2(edmund):
    scene = truth_scenes.empty_scene()
    truth_scenes.add_chequer(scene, edmund.lens, 3.9, 0.6)
    front, *others = edmund.lens.prescription.surfaces

    def picture(**shape):
        lens = replace(edmund.lens.prescription, surfaces=(replace(front, **shape), *others))
        return photograph(scene, replace(edmund.lens, prescription=lens), truth.WAVELENGTH_NM, (24, 32), samples=16)[0]

    by_conic, term = picture(conic=-1.0), 1 / (2 * front.radius_mm)
    for by_term in (picture(radius_mm=np.inf, aspheric=(term,)),
                    picture(radius_mm=np.inf, aspheric=(term,), odd_aspheric=(0.0, 1e-12))):  # as powers of r
        assert np.abs(by_term - by_conic).sum() < 0.01 * by_conic.sum()  # the noise is the same
    assert np.abs(picture() - by_conic).sum() > 0.03 * by_conic.sum()


def test_beads_land_where_rays_land(edmund):
    figure, = truth.distortion_figures(edmund, truth.BEADS[-3:], shape_px=(240, 320), samples=(32, 32))
    assert figure.value < 0.3


def test_a_picture_through_the_lens_is_upright_and_not_mirrored(edmund):
    scene = truth_scenes.empty_scene()
    truth_scenes.add_beads(scene, edmund.lens, np.array([[1.2, 0.6]]), 100)
    frame_px = truth.full_frame(edmund.lens, 48).shape_px
    for picture in (edmund.traced(scene, frame_px, 16), edmund.lensfield(scene, frame_px, 16)):
        row, column = np.unravel_index(picture.argmax(), picture.shape)
        assert column > 24 and row < 18


def test_a_picture_by_two_mirrors_is_upright_and_not_mirrored(reflex):
    scene = truth_scenes.empty_scene()
    truth_scenes.add_beads(scene, reflex.lens, np.array([[9.0, 4.5]]), 200, distance_mm=5e5)
    frame_px = truth.full_frame(reflex.lens, 48).shape_px
    for picture in (reflex.traced(scene, frame_px, 64), reflex.lensfield(scene, frame_px, 16)):
        row, column = np.unravel_index(picture.argmax(), picture.shape)
        assert column > 24 and row < 16


@pytest.mark.parametrize("bench", ["edmund", "reflex"])
def test_brightness_of_even_light_agrees_with_rays(bench, request):
    rings, bench = 5, request.getfixturevalue(bench)
    figures = truth.illumination_figures(bench, columns=48, samples=256, rings=rings)
    of_a_ring = five_sigma(bench.noise) * np.sqrt(rings) / bench.picture.mean()
    of_two = np.sqrt(2) * of_a_ring
    assert of_two < 0.01
    assert max(values(figures, "even light")) < 0.01 + of_two


def test_a_chequered_plane_agrees_with_rays(edmund):
    figures = truth.chequer_figures(edmund, columns=128, samples=(16, 16), block_px=32)
    assert max(values(figures, "chequer: shift")) < 0.3
    difference, = (figure for figure in figures if figure.what.startswith("chequer: relative L2"))
    assert difference.value < difference.limit


def test_widths_of_spots_agree_with_rays(petzval):
    figures = truth.spot_figures(petzval, heights=(0.7, 0.8), columns=1280, samples=(64, 256))
    noise = noise_of_a_spot(petzval)
    assert noise < 0.05
    assert max(values(figures, "spot")) < 0.05 + noise


def noise_of_a_spot(bench):
    """5 sigma of the last spot's centroid and RMS radius, relative to that radius, whichever is larger."""
    x, y = (place[bench.part] for place in truth.places_mm(bench.frame))
    light = bench.picture.sum()
    x, y = (place - (place * bench.picture).sum() / light for place in (x, y))
    square = ((x**2 + y**2) * bench.picture).sum() / light
    radius = ((x**2 + y**2) / square - 1) / 2  # contributions of light at a position to the radius, and to the centroid
    return SIGMAS * max(np.sqrt(((weight * bench.noise)**2).sum()) / light
                        for weight in (radius, x / np.sqrt(square), y / np.sqrt(square)))
