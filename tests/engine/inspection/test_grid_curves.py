"""Curves of lenses without rotational symmetry: PSFs, lateral colour, distortion and MTF by hand calculation."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import fine_grid_lens, gaussian_psf, make_lens, marked_psf
from lensfield.engine.inspection.curves import WHITE_NM, field_of, white_contrast, white_mtf
from lensfield.engine.inspection.grid_curves import (
    angle_rad,
    displacement_um,
    distortion_lines,
    distortion_percent,
    half_angles_rad,
    mirror_image,
    paths,
    psfs_at,
)


def coloured(nm, x, y):
    """1e-5 per nm more magnification along x, half of that along y."""
    return x * (1 + 1e-5 * (nm - 550)), y * (1 + 5e-6 * (nm - 550))


def test_a_place_has_the_mixture_of_the_psfs_of_the_nodes_around_it():
    psf = np.zeros((2, 9, 11, 5, 5))
    for row, column in ((2, 3), (2, 4), (3, 3), (3, 4)):
        psf[:, row, column, row, column - 1] = 1
    psf[..., 0, 0] += 1 - psf.sum(axis=(-2, -1))
    mixed, = psfs_at(fine_grid_lens(psf), np.array([-2.5 + 0.5 * 3.25]), np.array([-2 + 0.5 * 2.6]))[0]
    assert mixed[2, 2] == pytest.approx(0.4 * 0.75) and mixed[2, 3] == pytest.approx(0.4 * 0.25)
    assert mixed[3, 2] == pytest.approx(0.6 * 0.75) and mixed[3, 3] == pytest.approx(0.6 * 0.25)


@pytest.mark.parametrize("window", [25, 24])
@pytest.mark.parametrize("mirrored", [(True, True), (False, True), (True, False)])
def test_mirrored_places_have_mirrored_psfs(window, mirrored):
    lens = fine_grid_lens(marked_psf(6, 3, window), mirrored=mirrored)
    for x, y in ((1.0, 0.7), (-1.0, 0.7), (1.0, -0.7), (-1.0, -0.7)):
        psf = psfs_at(lens, np.array([x]), np.array([y]))[0, 0]
        up, right = (side < 0 and half for side, half in zip((y, x), mirrored, strict=True))
        expected = marked_psf(-6 if up else 6, -3 if right else 3, window)
        np.testing.assert_allclose(psf, expected, atol=1e-6)


def test_beyond_the_last_node_its_psf_continues():
    lens = fine_grid_lens(marked_psf(6, 3))
    assert psfs_at(lens, np.array([9.0]), np.array([-9.0]))[0, 0] == pytest.approx(lens.psf[0, 0, -1])


def test_a_mirror_image_keeps_the_chief_ray_in_place():
    for window in (8, 9):
        assert mirror_image(marked_psf(2, -3, window), 0).argmax() == marked_psf(-2, -3, window).argmax()
        assert mirror_image(marked_psf(2, -3, window), 1).argmax() == marked_psf(2, 3, window).argmax()


def test_lateral_colour_is_where_each_wavelength_lands():
    lens = fine_grid_lens(source_mm=coloured, wavelengths_nm=(400.0, 500.0, 600.0, 700.0))
    x, y = np.array([2.0, -1.0]), np.array([1.0, -1.5])
    moved_um = displacement_um(lens, np.array([450.0, 550.0, 900.0]), x, y)
    for one, nm in zip(moved_um, (450, 550, 700), strict=True):  # 700 nm is the last of the lens data
        np.testing.assert_allclose(one[:, 0], 1e3 * x * (1 / (1 + 1e-5 * (nm - 550)) - 1), atol=1e-3)
        np.testing.assert_allclose(one[:, 1], 1e3 * y * (1 / (1 + 5e-6 * (nm - 550)) - 1), atol=1e-3)
    np.testing.assert_allclose(moved_um[1], 0, atol=1e-9)


@pytest.mark.parametrize("mirrored, names, first", [
    ((True, True), ["x", "y", "diagonal"], [0, 0, 0]), ((False, True), ["x", "y", "diagonal"], [0, -1.8, -3]),
    ((True, False), ["x", "y", "diagonal"], [-2.4, 0, -3]),
    ((False, False), ["x", "y", "↗", "↘"], [-2.4, -1.8, -3, -3])])
def test_paths_show_each_different_half_of_the_field_once(mirrored, names, first):
    lines = paths(fine_grid_lens(mirrored=mirrored))
    assert [line.name for line in lines] == names
    assert [line.along_mm[0] for line in lines] == pytest.approx(first)
    assert [line.along_mm[-1] for line in lines] == pytest.approx([2.4, 1.8, 3, 3][:len(lines)])
    assert lines[-1].places_mm(3.0) == pytest.approx((2.4, -1.8 if names[-1] == "↘" else 1.8))


def test_paths_end_with_the_lens_data():
    lens = fine_grid_lens()
    lines = paths(replace(lens, within=lens.within * 1.25))  # to 2.0 and 1.6 mm of 2.4 and 1.8
    assert [line.along_mm[-1] for line in lines] == pytest.approx([2.0, 1.6, 2.5, 2.5], abs=0.19)
    assert [line.along_mm[0] for line in lines] == pytest.approx([-2.0, -1.6, -2.5, -2.5], abs=0.19)


def test_angles_are_in_front_of_the_lens():
    """The picture is squeezed twice: its focal length is 10.5 mm along y and 5.25 mm along x."""
    lens = fine_grid_lens(source_mm=lambda nm, x, y: (x, 0.9 * y), squeeze=2.0)
    x, y = np.array([2.1, 0.0, -2.1]), np.array([0.0, 2.0, 2.0])
    expected = np.arctan([2.1 / 5.25, 1.8 / 10.5, np.hypot(2.1 / 5.25, 1.8 / 10.5)])
    np.testing.assert_allclose(angle_rad(lens, x, y), expected, atol=1e-9)


def test_half_angles_are_the_mean_of_both_sides():
    lens = fine_grid_lens(source_mm=lambda nm, x, y: (x + 0.1, y))
    along_mm, half_rad = half_angles_rad(lens, paths(lens)[0])
    assert along_mm[-1] == pytest.approx(2.4)
    assert half_rad[-1] == pytest.approx((np.arctan(2.5 / 10.5) + np.arctan(2.3 / 10.5)) / 2)


def test_distortion_compares_distances_from_the_middle():
    lens = fine_grid_lens(source_mm=lambda nm, x, y: (1.25 * x, 0.8 * y))
    percent = distortion_percent(lens, np.array([0.0, 2.0, 0.0]), np.array([0.0, 0.0, -1.5]))
    assert percent == pytest.approx([0, -20, 25])


def test_a_distorted_grid_is_where_its_formula_puts_it():
    lens = fine_grid_lens(source_mm=lambda nm, x, y: (1.1 * x + 0.05 * y, 0.95 * y - 0.02 * x))
    ideal_mm, real_mm = distortion_lines(lens)
    known = np.isfinite(real_mm[..., 0])
    x, y = real_mm[known].T
    np.testing.assert_allclose(ideal_mm[known], np.stack([1.1 * x + 0.05 * y, 0.95 * y - 0.02 * x], axis=1), atol=1e-9)
    upright = [line[0, 0] for line in ideal_mm if np.ptp(line[:, 0]) == 0]
    level = [line[0, 1] for line in ideal_mm if np.ptp(line[:, 1]) == 0]
    np.testing.assert_allclose(np.diff(upright), 0.6)
    np.testing.assert_allclose(np.diff(level), 0.6)
    assert upright[0] == pytest.approx(-2.4) and level[-1] == pytest.approx(1.8)
    assert np.abs(x).max() > 2.2 and np.abs(y).max() > 1.75


def test_mtf_along_x_is_that_of_the_same_lens_over_heights():
    """A rotationally symmetric lens with lateral colour and round PSFs: vertical lines are tangential there."""
    def stretched(nm, p):
        return p * (1 + 5e-5 * (nm - 550))

    nm, psf = (400.0, 550.0, 700.0), gaussian_psf(3, 3, 1.0, 41)
    radial = make_lens(psf, stretched, psf_pitch_um=1.0, wavelengths_nm=nm, heights_mm=np.linspace(0, 2.4, 9))
    grid = fine_grid_lens(psf, lambda nm, x, y: (x / (1 + 5e-5 * (nm - 550)), y / (1 + 5e-5 * (nm - 550))),
                          psf_pitch_um=1.0, wavelengths_nm=nm)
    x = field_of(radial).optics.real_height_mm
    moved_um = displacement_um(grid, WHITE_NM, x, np.zeros_like(x))[..., ::-1]
    horizontal, vertical = white_contrast(grid, psfs_at(grid, x, np.zeros_like(x)), moved_um, [20.0, 40.0])
    tangential, sagittal = white_mtf(radial, [20.0, 40.0])
    assert tangential[-1, 1] < 0.8 * sagittal[-1, 1]
    np.testing.assert_allclose(vertical, tangential, atol=1e-3)
    np.testing.assert_allclose(horizontal, sagittal, atol=1e-3)
