"""Each pixel's light gets the PSF of the paraxial height where it came from, not of the real height where it lands."""

import numpy as np
import pytest

from lenses import make_lens, marked_psf, points_image
from lensfield.engine import Options, simulate

PITCH_UM = 25.0
STEP_PX = 4  # added to the offset of the PSF at each height


def barrel_lens():
    """Chief rays land at p - p^3 / 8, an eighth further in at 1 mm; PSFs are points that move outwards with height."""
    heights_mm = np.linspace(0, 1.5, 4)
    table = [marked_psf(STEP_PX * index, 0, window=2 * STEP_PX * heights_mm.size + 1) for index in range(4)]
    return make_lens(np.stack([table, table]), lambda nm, p: p - p**3 / 8, heights_mm=heights_mm,
                     psf_pitch_um=PITCH_UM)


@pytest.mark.parametrize("options", [Options(method="exact"), Options(accuracy=1e-3)], ids=["exact", "by accuracy"])
@pytest.mark.parametrize("x, y", [(40, 0), (0, -40), (-24, 32)])
def test_the_psf_is_that_of_the_paraxial_height(options, x, y):
    """1 mm from the axis is 40 px: the chief ray lands at 35 px, and the PSF of 1 mm moves the light 8 px outwards.

    Looked up at the real height, 0.875 mm, a quarter of the light would have the previous PSF: 7 px on average.
    """
    image = simulate(points_image([(x, y)], (121, 121), pitch_um=PITCH_UM), barrel_lens(), options)
    light = image.cube[0] / image.cube[0].sum()
    rows, columns = np.indices(light.shape)
    landed = (light * (columns - 60)).sum(), (light * (60 - rows)).sum()
    assert landed == pytest.approx((43 / 40 * x, 43 / 40 * y), abs=0.1)
