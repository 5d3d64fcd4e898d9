"""Lenses with the distortion of given camera models, and an off-centre frame of odd sides in front of them."""

import numpy as np
import scipy

from lenses import make_grid_lens, make_lens
from lensfield.engine.image.pixel_grid import PixelGrid

FRAME = PixelGrid((90, 140), 22.0, centre_px=(61.0, 42.0))  # its farthest corner is 2.6 mm from the axis
HEIGHTS_MM = np.linspace(0, 4, 33)
FOCAL_MM = 10.5  # of `make_lens`, focused at 105 mm
FOCAL_PX = FOCAL_MM / 0.022


def radial_lens(distorted, heights_mm=HEIGHTS_MM):
    """A lens whose distorted tangents are this function of the tangents."""
    return make_lens(real_height_mm=lambda nm, p: FOCAL_MM * distorted(p / FOCAL_MM), heights_mm=heights_mm)


def modelled_lens(model, coefficients, squeeze=1.0):
    """A lens without symmetry, with the distortion of a model."""
    focal_mm = np.array([FOCAL_MM / squeeze, FOCAL_MM])

    def source_mm(nm, x, y):
        wanted = np.stack([x, -y], axis=-1) / focal_mm

        def missing(flat):
            tangents = flat.reshape(wanted.shape)
            directions = np.concatenate([tangents, np.ones((*wanted.shape[:-1], 1))], axis=-1)
            return (model.place(directions, coefficients) - wanted).ravel()

        tangents = scipy.optimize.newton_krylov(missing, wanted.ravel(), f_tol=1e-12).reshape(wanted.shape)
        return focal_mm[0] * tangents[..., 0], -focal_mm[1] * tangents[..., 1]

    return make_grid_lens(source_mm=source_mm, rows=17, columns=21, half_mm=(2.2, 2.6), squeeze=squeeze,
                          within=lambda x, y: np.maximum(abs(x) / 2.6, abs(y) / 2.2))
