"""The whole chain against rays through the real lens, small; `make validate` has the figures.

The limits are those of `validation/traced_lens_truth.py`, and 5 sigma of the noise that fewer samples leave.
"""

from dataclasses import replace

import numpy as np
import pytest

import traced_lens_truth as truth
import truth_scenes
from lens_surfaces import Surfaces
from lensfield.engine.errors import LensError
from noise import SIGMAS, assert_means, five_sigma
from traced_lens import Window, photograph

DENSITY = 1 / 400  # W m^-2 sr^-1 nm^-1 of a strength of 1


class Bench(truth.Bench):
    """Traces each picture with two seeds: what it gives is their mean, and what it notes half their difference, the
    noise of that."""

    def traced(self, scene, window, samples, seed=0):
        first, second = (super(Bench, self).traced(scene, window, samples, 2 * seed + half) for half in (0, 1))
        self.window, self.picture, self.noise = window, (first + second) / 2, (first - second) / 2
        return self.picture


@pytest.fixture(scope="module")
def edmund():
    return Bench("edmund-54852")


@pytest.fixture(scope="module")
def petzval():
    return Bench("kodak-petzval-100mm")


def values(figures, start):
    found = [figure.value for figure in figures if figure.what.startswith(start)]
    assert found
    return found


def test_a_bare_hole_gives_the_irradiance_of_a_cone():
    radius_mm, distance_mm = 2.0, 5.0
    one = np.ones(1)
    hole = Surfaces("edmund-54852", 0.0, np.array([truth.WAVELENGTH_NM]), np.inf * one, distance_mm * one, 0 * one,
                    radius_mm * one, np.zeros((1, 0)), np.ones((1, 1)), np.zeros((1, 1)))
    scene = truth_scenes.empty_scene()
    truth_scenes.set_even_light(scene, 1.0)
    picture, _ = photograph(scene, hole, truth.WAVELENGTH_NM, Window((8, 8), 1.0), samples=8192)
    cone = np.pi * radius_mm**2 / (radius_mm**2 + distance_mm**2)  # pi sin^2
    assert_means(picture, cone * DENSITY, 1e-3)


def test_a_parabola_is_the_same_lens_as_a_conic_or_as_a_term_in_r2(edmund):
    scene, window = truth_scenes.empty_scene(), Window((24, 32), 150.0)
    truth_scenes.add_chequer(scene, edmund.lens, 3.9, 0.6)

    def picture(front_radius_mm, front_conic, front_term):
        shape = edmund.surfaces.radius_mm.size
        radius_mm, conic, terms = edmund.surfaces.radius_mm.copy(), np.zeros(shape), np.zeros((shape, 1))
        radius_mm[0], conic[0], terms[0] = front_radius_mm, front_conic, front_term
        lens = replace(edmund.surfaces, radius_mm=radius_mm, conic=conic,
                       aspheric=terms if front_term else terms[:, 1:])
        return photograph(scene, lens, truth.WAVELENGTH_NM, window, samples=16)[0]

    radius_mm = edmund.surfaces.radius_mm[0]
    by_conic, by_term = picture(radius_mm, -1, 0), picture(np.inf, 0, 1 / (2 * radius_mm))
    assert np.abs(by_term - by_conic).sum() < 0.01 * by_conic.sum()  # the noise is the same
    assert np.abs(picture(radius_mm, 0, 0) - by_conic).sum() > 0.03 * by_conic.sum()


def test_beads_land_where_rays_land(edmund):
    figure, = truth.distortion_figures(edmund, truth.BEADS[-3:], shape_px=(240, 320), samples=(32, 32))
    assert figure.value < 0.3


def test_a_picture_through_the_lens_is_upright_and_not_mirrored(edmund):
    scene = truth_scenes.empty_scene()
    truth_scenes.add_beads(scene, edmund.lens, np.array([[1.2, 0.6]]), 100)
    frame = truth.frame_window(edmund.lens, 48)
    for picture in (edmund.traced(scene, frame, 16), edmund.lensfield(scene, frame.shape_px, 16)):
        row, column = np.unravel_index(picture.argmax(), picture.shape)
        assert column > 24 and row < 18


def test_even_light_is_as_bright_as_rays_make_it(edmund):
    rings = 5
    figures = truth.illumination_figures(edmund, columns=48, samples=256, rings=rings)
    of_a_ring = five_sigma(edmund.noise) * np.sqrt(rings) / edmund.picture.mean()
    of_two = np.sqrt(2) * of_a_ring
    assert of_two < 0.01
    assert max(values(figures, "even light")) < 0.01 + of_two


def test_a_chequered_plane_is_where_rays_show_it(edmund):
    figures = truth.chequer_figures(edmund, columns=128, samples=(16, 16), block_px=32)
    assert max(values(figures, "chequer: shift")) < 0.3
    difference, = (figure for figure in figures if figure.what.startswith("chequer: relative L2"))
    assert difference.value < difference.asked


def test_spots_are_as_wide_as_rays_make_them(petzval):
    figures = truth.spot_figures(petzval, heights=(0.7, 0.8), columns=1280, samples=(64, 256))
    noise = noise_of_a_spot(petzval)
    assert noise < 0.05
    assert max(values(figures, "spot")) < 0.05 + noise


def noise_of_a_spot(bench):
    """5 sigma of the last one's centroid and RMS radius, as parts of that radius, whichever is more."""
    x, y = bench.window.places_mm()
    light = bench.picture.sum()
    x, y = (place - (place * bench.picture).sum() / light for place in (x, y))
    square = ((x**2 + y**2) * bench.picture).sum() / light
    radius = ((x**2 + y**2) / square - 1) / 2  # what light at a place adds to the radius, and to the centroid
    return SIGMAS * max(np.sqrt(((weight * bench.noise)**2).sum()) / light
                        for weight in (radius, x / np.sqrt(square), y / np.sqrt(square)))


def test_a_wavelength_that_was_not_looked_up_is_refused(edmund):
    with pytest.raises(LensError, match="wavelength is 500 nm: expected one of 453, 562, 655"):
        edmund.surfaces.at(500)
