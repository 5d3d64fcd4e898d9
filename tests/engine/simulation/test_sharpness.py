"""The sharpness of in-focus light: slanted edges and lamps, with and without the detail of radiance."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import gaussian_psf, make_grid_lens, make_lens, tinted
from lensfield.engine import Options, Report, SpectralImage, simulate
from lensfield.engine.image.detail import Detail, merged
from lensfield.engine.image.irradiance import irradiance_per_radiance
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.supersampling import merge_pixels
from lensfield.engine.lens.entrance_pupil import focus_nearness

PITCH_UM, SIGMA_PX = 5.0, 0.45
FRAME, MARGIN = (42, 60), 12
AXIS = 83.3, -68.6  # row and column: off-centre, in another place than any mirrored one
NM = 450.0, 550.0, 650.0
SLANT_RAD = np.deg2rad(6.1)
CYCLES_PER_PX = np.arange(1, 11) / 20
TINTS = np.array([0.6, 1.0, 0.8])
LAMPS, LAMP_PX, FINEST = [(9.3, 12.8), (20.6, 30.1), (31.2, 47.4), (10.9, 45.2), (33.7, 15.5)], 1.6, 12
CLOSE = 0.03  # in an MTF: the target
RIM = 0.003  # of the light beyond an edge; the error of even light is included
SOFT = 0.3  # misplaced light of lamps without detail
OVER = 6  # points across a capture's pixel, or a bin of the edge's profile, along each side


@pytest.fixture(scope="module")
def lens():
    """Barrel distortion shifts pixels by all fractions of a pixel, differently in each colour."""
    return tinted(make_lens(
        gaussian_psf(SIGMA_PX * PITCH_UM, SIGMA_PX * PITCH_UM, 0.25, 81), psf_pitch_um=0.25,
        real_height_mm=lambda nm, height: height * (1 - 0.012 * height**2 - 2e-5 * (nm - 550))))


def radiance(picture, times):
    """A picture, a function of row and column in pixels of the frame, as radiance in `times` times finer pixels."""
    grid = PixelGrid(tuple(n + 2 * MARGIN for n in FRAME), PITCH_UM, AXIS, (MARGIN, MARGIN)).finer(times)
    rows, columns = ((np.arange(OVER * times * (n + 2 * MARGIN)) + 0.5) / (OVER * times) - 0.5 - MARGIN for n in FRAME)
    means = merge_pixels(picture(rows[:, None], columns).astype(np.float32), OVER)
    return SpectralImage(TINTS[:, None, None] * means, NM, grid)


def edge(row, column):
    return ((column - 31.7) * np.cos(SLANT_RAD) + (row - 20.2) * np.sin(SLANT_RAD) > 0) * np.ones_like(row)


def lamps(row, column):
    return sum((abs(row - y) < LAMP_PX / 2) & (abs(column - x) < LAMP_PX / 2) for y, x in LAMPS)


def response(picture):
    """The MTF of a nearly vertical edge: the spectrum of its derivative, from pixels by their distance to the edge."""
    inside = picture[6:-6, 6:-6]
    columns = np.arange(inside.shape[1])
    steps = np.diff(inside, axis=1)
    rows = np.arange(len(steps))
    line = np.polyfit(rows, (steps * (columns[1:] - 0.5)).sum(axis=1) / steps.sum(axis=1), 2)
    slope = np.polyval(np.polyder(line), rows)
    distance = (columns - np.polyval(line, rows)[:, None]) / np.hypot(1, slope)[:, None]
    bins = np.round(distance * OVER).astype(int)
    bins -= bins.min()
    count = np.bincount(bins.ravel())
    profile = np.bincount(bins.ravel(), inside.ravel())[count > 0] / count[count > 0]
    profile = profile[np.abs(np.unique(bins) / OVER + distance.min()) < 12]
    spread = np.diff(profile)
    waves = np.exp(-2j * np.pi * np.outer(CYCLES_PER_PX, np.arange(spread.size) / OVER))
    return np.abs(waves @ spread) / spread.sum() / np.sinc(CYCLES_PER_PX / OVER)**2  # of bins and differences


def gaussian_mtf(sigma_px):
    return np.exp(-2 * (np.pi * sigma_px * CYCLES_PER_PX)**2)


def simulated(lens, picture, times, supersampling=1):
    """The irradiance (wavelength, row, column) relative to that of radiance 1, and the reported softening."""
    report = Report()
    image = radiance(picture, times)
    result = simulate(image.coarser(times) if times > 1 else image, lens,
                      Options(accuracy=1e-3, supersampling=supersampling), report=report)
    assert result.frame_px == FRAME and result.pitch_um == PITCH_UM
    light = [irradiance_per_radiance(lens.at_wavelength(nm).transmittance, lens.f_number_effective) for nm in NM]
    return result.cube / np.multiply(light, TINTS)[:, None, None], report.lens_image.softening_px


@pytest.mark.parametrize("supersampling", [1, 2])
def test_edges_are_as_soft_as_the_report_states(lens, supersampling):
    """The response of whole pixels depends on their places, too: it is less close, up to a quarter of the
    sampling frequency."""
    planes, softening_px = simulated(lens, edge, 1, supersampling)
    expected = gaussian_mtf(np.hypot(SIGMA_PX, softening_px)) * np.sinc(CYCLES_PER_PX)
    for plane in planes:
        close = CYCLES_PER_PX < 0.26
        np.testing.assert_allclose(response(plane)[close], expected[close], atol=2 * CLOSE)


@pytest.mark.parametrize("times, supersampling", [(2, 1), (3, 1), (3, 3), (2, 4)])
def test_edges_are_as_sharp_as_lens_and_pixels_with_detail(lens, times, supersampling):
    planes, softening_px = simulated(lens, edge, times, supersampling)
    assert softening_px < 0.16
    for plane in planes:
        np.testing.assert_allclose(response(plane), gaussian_mtf(SIGMA_PX) * np.sinc(CYCLES_PER_PX), atol=CLOSE)
        assert plane.min() >= 0 and plane.max() < 1 + RIM


def test_a_sharper_lens_leaves_no_rims():
    """PSFs far smaller than a pixel hide nothing: each edge is one or two parts wide."""
    sharp = tinted(make_lens(gaussian_psf(0.5, 0.5, 0.25, 81), psf_pitch_um=0.25,
                             real_height_mm=lambda nm, height: height * (1 - 0.012 * height**2)))
    for plane in simulated(sharp, edge, 2)[0]:
        assert plane.min() >= 0 and plane.max() < 1 + RIM


@pytest.fixture(scope="module")
def sharp_lamps(lens):
    """Lamps in far finer pixels, of which the frame's are means."""
    fine = simulate(radiance(lamps, FINEST), lens, Options()).cube
    light = [irradiance_per_radiance(lens.at_wavelength(nm).transmittance, lens.f_number_effective) for nm in NM]
    return [merge_pixels(plane, FINEST) / scale for plane, scale in zip(fine, np.multiply(light, TINTS), strict=True)]


@pytest.mark.parametrize("times, most", [(2, 0.10), (3, 0.06)])
def test_lamps_are_sharp_with_detail(lens, sharp_lamps, times, most):
    without = simulated(lens, lamps, 1)[0]
    for plane, even, true in zip(simulated(lens, lamps, times)[0], without, sharp_lamps, strict=True):
        assert plane.sum() == pytest.approx(true.sum(), rel=0.01)
        assert np.abs(plane - true).sum() / true.sum() < most
        assert np.abs(even - true).sum() / true.sum() > SOFT


def test_even_light_stays_even_with_detail(lens):
    """On pixels as coarse as without detail."""
    for plane in simulated(lens, lambda row, column: np.ones((row.size, column.size)), 3)[0]:
        np.testing.assert_allclose(plane, 1, rtol=1e-3)


def test_layers_in_focus_are_as_sharp_as_a_flat_picture(lens):
    image = radiance(edge, 3).coarser(3)
    rows, columns = image.grid.shape_px
    focus_mm = np.full((rows, columns), 1 / focus_nearness(lens))
    layer = Layer(image.cube, np.ones((rows, columns)), focus_mm, (0, 0), image.detail)
    report = Report()
    result = simulate(LayeredRadiance([layer], image.wavelengths_nm, image.grid), lens, report=report)
    np.testing.assert_array_equal(result.cube, simulate(image, lens).cube)
    assert report.lens_image.plan.supersampling == 2


def test_edges_of_layers_in_finer_columns_are_as_sharp_with_detail():
    """Through a lens with a squeeze: four columns of a pixel, each with a detail of two rows and two columns."""
    lens = tinted(make_grid_lens(
        gaussian_psf(SIGMA_PX * PITCH_UM, SIGMA_PX * PITCH_UM, 0.25, 81), psf_pitch_um=0.25, squeeze=2.0,
        source_mm=lambda nm, x, y: (x * (1 + 0.012 * x**2), y * (1 + 0.01 * x**2))))
    image = radiance(edge, 8)
    light = image.cube.reshape(len(NM), -1, 4, image.cube.shape[-1]).mean(axis=2)
    grid = replace(image.grid.coarser(8), squeeze=2.0).finer_across(4)
    layer = Layer(merged(light, 2), np.ones(grid.shape_px), np.full(grid.shape_px, 1 / focus_nearness(lens)), (0, 0),
                  Detail.of(light, NM, 2))
    result = simulate(LayeredRadiance([layer], NM, grid, lens.capture_focal_length_mm), lens, Options(accuracy=1e-3))
    scale = [irradiance_per_radiance(lens.at_wavelength(nm).transmittance, lens.f_number_effective) for nm in NM]
    for plane in result.cube / np.multiply(scale, TINTS)[:, None, None]:
        assert plane.shape == FRAME and plane.min() >= 0 and plane.max() < 1 + RIM
        np.testing.assert_allclose(response(plane), gaussian_mtf(SIGMA_PX) * np.sinc(CYCLES_PER_PX), atol=CLOSE)
