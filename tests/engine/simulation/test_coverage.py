"""The share of each pixel's light that comes from the areas of masks."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import tinted
from lensfield.engine import Options, SpectralImage, load_lens, simulate
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.rays.rings import Rings
from lensfield.engine.simulation.coverage import coverage

NM = np.array([450.0, 500.0, 550.0, 600.0, 650.0])
GRID = PixelGrid((58, 70), 60.0, (20.0, 41.0), overscan_px=(5, 6))
OPTIONS = Options(accuracy=0.01)


@pytest.fixture(scope="module")
def lens():
    """A lens with dark corners, of glass that absorbs some light."""
    return tinted(load_lens("nikkor-28mm", Rings(focus_mm=1500.0), "preview", wavelengths_nm=NM))


@pytest.fixture(scope="module")
def masks():
    """A box, all others, and everything."""
    box = np.zeros(GRID.shape_px, np.float32)
    box[22:31, 34:52] = 1
    return box, 1 - box, np.ones_like(box)


def radiance_of(plane):
    return SpectralImage(np.broadcast_to(plane, (NM.size, *plane.shape)).astype(np.float32), NM, GRID)


def test_masks_share_the_light_of_each_pixel(lens, masks):
    box, others, everything = coverage(masks, radiance_of(masks[0]), lens, OPTIONS)
    assert box.shape == GRID.frame_px
    np.testing.assert_allclose(box + others, 1, atol=2 * OPTIONS.accuracy)
    np.testing.assert_array_equal(everything, 1)
    assert 0.02 < box.mean() < 0.15 and box.max() > 0.98 and box.min() == 0
    np.testing.assert_array_equal(coverage(masks[1:2], radiance_of(masks[0]), lens, OPTIONS)[0], others)


def test_a_white_mask_is_as_the_lens_shows_it(lens, masks):
    """At a wavelength, coverage is irradiance over that of an even scene."""
    one = replace(radiance_of(masks[0]), cube=np.stack([masks[0]]), wavelengths_nm=NM[2:3])
    through, even = (simulate(replace(one, cube=np.stack([mask])), lens, OPTIONS).cube[0]
                     for mask in (masks[0], masks[2]))
    np.testing.assert_allclose(coverage(masks[:1], one, lens, OPTIONS)[0], through / even, atol=1e-6)


def test_masks_of_layers_blur_with_their_depth_and_cover_each_other(lens, masks):
    box, _, everything = masks
    near, far = (Layer(np.broadcast_to(alpha, (NM.size, *alpha.shape)), alpha, np.full(alpha.shape, mm))
                 for alpha, mm in ((box, 400.0), (everything, 1500.0)))
    layers = LayeredRadiance((near, far), NM, GRID, lens.capture_focal_length_mm)
    nothing = np.zeros_like(box)
    of_near, of_far, both = coverage([(box, nothing), (nothing, everything), (box, everything)], radiance_of(box), lens,
                                     OPTIONS, layers=layers)
    np.testing.assert_allclose(of_near + of_far, both, atol=0.02)  # the number of rays depends on the light
    np.testing.assert_allclose(both, 1, atol=0.02)
    in_focus, = coverage([box], radiance_of(box), lens, OPTIONS)
    assert np.count_nonzero(of_near > 0.01) > np.count_nonzero(in_focus > 0.01), "it is out of focus"
