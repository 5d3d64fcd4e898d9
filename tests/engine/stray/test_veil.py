"""Veiling glare: the glare index that is put in, energy, and sums without transforms."""

import numpy as np
import pytest

from lenses import make_lens, tinted
from lensfield.engine import simulate
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.sources import Sources
from lensfield.engine.image.spectral_image import SpectralImage
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.stray.arrivals import arrivals
from lensfield.engine.stray.veil import (
    CLEANLINESS,
    Lobe,
    Veil,
    add_veil,
    glare_chart,
    glare_index,
    index_in,
    veil_of,
    veil_with_index,
)
from varied_lenses import varied_lens

pytestmark = pytest.mark.one_blender
NM = np.array([450.0, 550.0, 650.0])
GRID = PixelGrid((150, 210), 60.0, centre_px=(60.0, 120.0), overscan_px=(10, 12))
FRAME = GRID.frame()
NARROW = Veil((Lobe(0.2, -2.0, 40.0, 0.01, -4.0, np.inf),), 550.0)


def wide_lens():
    return tinted(make_lens(efl_mm=40.0, heights_mm=np.linspace(0, 22, 5), object_distance_mm=np.inf,
                            magnification=0.0, sensor_mm=(36.0, 24.0), wavelengths_nm=(400.0, 700.0)))


def scattered(radiance, veil, lens=None, grid=GRID, beyond=None):
    lens = lens or wide_lens()
    picture = SpectralImage(np.stack([radiance] * NM.size), NM, grid)
    cube, light = np.zeros((NM.size, *grid.frame_px), np.float32), arrivals(picture, lens, beyond)
    return cube, add_veil(cube, grid.frame(), light, veil), light


@pytest.mark.sample(3)
@pytest.mark.parametrize("cleanliness", CLEANLINESS)
@pytest.mark.parametrize("name", ["cooke-triplet-50mm", "nikkor-28mm", "edmund-54852"])
def test_the_chart_returns_the_glare_index_that_is_put_in(name, cleanliness):
    """On the lens image of the chart, with twice the pixels of the chart for the veil."""
    lens = varied_lens(name)
    width_mm, _ = lens.sensor_mm
    frame = PixelGrid((320, 480), 1e3 * width_mm / 480)
    veil = veil_with_index(lens, frame, cleanliness, 0.025)
    assert glare_index(lens, frame, veil) == pytest.approx(0.025, rel=1e-5)
    chart = glare_chart(lens, frame, np.array([veil.reference_nm]))
    image = simulate(chart, lens)
    blurred = index_in(image.cube[0])
    image.cube[:] *= 1 - veil.share(veil.reference_nm)
    add_veil(image.cube, frame, arrivals(chart, lens), veil)
    assert index_in(image.cube[0]) - blurred == pytest.approx(0.025, rel=0.01)


@pytest.mark.parametrize("name", ["cooke-triplet-50mm", "nikkor-28mm"])
def test_dirt_scatters_more_and_polish_most_at_short_wavelengths(name):
    lens = varied_lens(name)
    frame = PixelGrid((160, 240), 150.0)
    new, dusty, hazy = (veil_of(lens, cleanliness) for cleanliness in CLEANLINESS)
    indices = [glare_index(lens, frame, veil) for veil in (new, dusty, hazy)]
    assert 0.001 < indices[0] < 0.5 * indices[1] < 0.03 and indices[1] < indices[2] < 0.08
    rough = Veil(tuple(lobe for lobe in new.lobes if lobe.power), new.reference_nm)
    np.testing.assert_allclose(rough.share(NM) * NM**2, rough.share(NM[1]) * NM[1]**2)
    assert 1e-4 < rough.share(550.0) < 2e-3  # 1 nm: some 1e-4 per surface of glass


def test_dust_lies_on_both_outer_surfaces():
    """And diffracts as much light as it blocks."""
    new, dusty = (veil_of(varied_lens("cooke-triplet-50mm"), cleanliness) for cleanliness in ("new", "dusty"))
    more = CLEANLINESS["dusty"].dust - CLEANLINESS["new"].dust
    assert dusty.share(550.0) - new.share(550.0) == pytest.approx(2 * 2 * more)


def test_no_lens_scatters_more_than_all_light():
    with pytest.raises(InputError, match="glare index.*more than all light"):
        veil_with_index(wide_lens(), PixelGrid((160, 240), 150.0), "dusty", 5.0)


def test_polished_surfaces_scatter_by_their_step_of_the_index():
    """A triplet of SK16 and F2 in air: (2 pi (n - 1) nm / wavelength)^2 for each of six surfaces."""
    veil = veil_of(varied_lens("cooke-triplet-50mm"), "new")
    steps = [np.sqrt(lobe.share) * veil.reference_nm / (2 * np.pi) for lobe in veil.lobes if lobe.power]
    assert len(steps) == 6 and all(0.55 < step < 0.75 for step in steps)
    assert steps[::2] == pytest.approx(steps[1::2])


@pytest.mark.parametrize("lobe", [Lobe(0.1, 0.0, 40.0, 0.01, -1.5), Lobe(0.3, 0.0, 20.0, 0.3, -3.0),
                                  Lobe(0.2, 0.0, 43.0, 0.5, -4.0, np.inf)])
def test_a_lobe_has_its_share(lobe):
    distance_mm = np.append(0, np.geomspace(1e-4, 1e5, 200_001))
    rings = 2 * np.pi * distance_mm * lobe.spread(distance_mm)
    light = np.sum((rings[1:] + rings[:-1]) / 2 * np.diff(distance_mm))
    assert light == pytest.approx(lobe.share, rel=1e-3)


def test_scattered_light_is_what_images_lose_and_falls_around_them():
    """A small spot off the axis, of a narrow veil: all of its scattered light is in the frame, around the spot."""
    radiance = np.zeros(GRID.shape_px)
    radiance[53:57, 130:133] = 2
    cube, share, light = scattered(radiance, NARROW)
    np.testing.assert_allclose(share, 0.2 * (550 / NM) ** 2)
    np.testing.assert_allclose(cube.sum(axis=(1, 2)), share * light.light.sum(axis=1), rtol=0.03)
    rows, columns = np.indices(FRAME.shape_px)
    middle = [(cube * axis).sum(axis=(1, 2)) / cube.sum(axis=(1, 2)) for axis in (rows, columns)]
    np.testing.assert_allclose(middle, np.stack([[54.5 - 10, 131 - 12]] * NM.size, axis=1), atol=1)


def test_a_veil_is_the_sum_over_all_light():
    """Without cells and transforms; the overscan and sources beyond it count."""
    rng = np.random.default_rng(3)
    radiance = np.zeros(GRID.shape_px)
    for row, column in zip(rng.integers(0, 60, 12), rng.integers(0, 210, 12), strict=True):
        radiance[row, column] = rng.random()
    radiance[3, 100] = 2  # in the overscan
    direction = np.array([0.4, 0.1, 1]) / np.linalg.norm([0.4, 0.1, 1])
    beyond = Sources(direction[None], np.array([np.inf]), np.full((1, 3), 2e-5), NM, np.zeros(1), ("lamp",))
    veil = veil_of(wide_lens(), "dusty")
    cube, _, light = scattered(radiance, veil, beyond=beyond)
    assert light.light[0, -1] > 0.5 * light.light[0].max()
    x_mm, y_mm = FRAME.axes_mm()
    for row, column in ((77, 170), (110, 90), (125, 22)):
        distance_mm = np.hypot(light.x_mm - x_mm[column], light.y_mm - y_mm[row])
        assert (distance_mm[light.light > 0] > 1.5).all()
        expected = sum((light.light * lobe.spread(distance_mm)).sum(axis=1) * (NM / veil.reference_nm) ** lobe.power
                       for lobe in veil.lobes) * 0.06**2
        np.testing.assert_allclose(cube[:, row, column], expected, rtol=0.08)  # cells
