"""CODE V's PSF matrices: centre, orientation, and invalid matrices."""

import numpy as np
import pytest

from lensfield.engine import LensError
from lensfield.engine.lens_files.codev import psf_grid
from lensfield.engine.lens_files.psf_grid import psf_table
from lensfield.engine.runtime.text import decoded
from refusals import refused
from vendor_files import ENCODINGS, damages, matrix_text

# A matrix as BUF EXP exports it, Strehl x 100, with light two rows after and one column after the chief ray. Rows
# ascend with y, so the light is above and to the right of the chief ray.
MARKED = np.full((8, 8), 0.5)
MARKED[4, 4], MARKED[6, 5] = 30, 60


@pytest.mark.parametrize("side, v, u", [("+y", 2, 1), ("-y", -2, -1)])
def test_the_chief_ray_is_in_the_middle_and_rows_ascend_with_y(side, v, u):
    grid = psf_grid(matrix_text(MARKED), "psf.dat", 0.5)
    assert grid.centre == (4, 4) and grid.pitch_um == 0.5
    psf, _ = psf_table([[grid]], side)
    centre = psf.shape[-1] // 2
    assert np.unravel_index(psf[0, 0].argmax(), psf.shape[2:]) == (centre + v, centre + u)
    assert psf[0, 0, centre, centre] / psf.max() == pytest.approx(0.5, rel=1e-6)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("separator", ["\t", "   ", ", "])
def test_any_separator_and_encoding_is_read(encoding, separator):
    grid = psf_grid(decoded(matrix_text(MARKED, separator=separator).encode(encoding)), "psf.dat", 0.5)
    np.testing.assert_allclose(grid.values, MARKED / 60, rtol=1e-6)


@pytest.mark.parametrize("text, field", [
    ("", "PSF samples"), ("1 2 3", "PSF samples"), ("1 2\n3 x", "PSF samples"), ("nan " * 9, "PSF samples"),
    ("0 " * 9, "PSF"), ("-1 " * 9, "PSF"), ("1 " * 4, "PSF")])
def test_anything_but_a_square_matrix_of_light_is_refused(text, field):
    with refused(LensError, field=field, where="psf.dat"):
        psf_grid(text, "psf.dat", 0.5)


def test_damage_is_harmless_or_a_lens_error():
    for damaged in damages(matrix_text(MARKED).encode(), 200):
        try:
            psf_grid(decoded(damaged), "psf.dat", 0.5)
        except LensError as error:
            assert "\n" not in str(error)
