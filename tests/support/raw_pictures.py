"""Small raw pictures: of a colour chart, and of a scene that every mirror and turn changes."""

from dataclasses import replace

import numpy as np

from lensfield.engine import SpectralImage
from lensfield.engine.library.bodies import load_camera
from lensfield.engine.sensor.exposure import Exposure, expose
from lensfield.engine.spectral.colour_difference import ciede2000, lab_from_xyz
from lensfield.engine.spectral.spectra import colour_matching, library_names, load_spectrum

XTRANS = "GBGGRG", "RGRBGB", "GBGGRG", "GRGGBG", "BGBRGR", "GRGGBG"
QUAD_BAYER = "RRGG", "RRGG", "GGBB", "GGBB"
NM, FINE_NM = np.arange(380.0, 781, 10), np.arange(380.0, 781)
CHART = [name for name in library_names("reflectance") if name.startswith("chart-")]
PATCH_PX = 60
GREYS = slice(18, 24)


def small_camera(name="sony-a7-iv", filters=("RG", "GB"), shape_px=(301, 402), **changes):
    """A camera of the library with fewer pixels of 4 um, and perhaps another filter array."""
    return replace(load_camera(name), filters=filters, shape_px=shape_px, pitch_um=4.0, **changes)


def uneven_light(shape_px, level=0.01):
    """Irradiance without any symmetry: brighter to the right and below, in colours that change across."""
    down, right = np.mgrid[:shape_px[0], :shape_px[1]] / np.reshape(shape_px, (2, 1, 1))
    nm = np.linspace(400, 700, 16)
    cube = (0.1 + 0.6 * right + 0.3 * down**2) * (1 + 0.5 * np.cos(nm[:, None, None] / 60 + 2 * down)) * level / 300
    return SpectralImage(cube, nm, pitch_um=4.0, quantity="irradiance")


def uneven_raw(camera, shape_px, iso=200.0, **exposure):
    return expose(uneven_light(shape_px), camera, Exposure(1 / 60, iso, **exposure))


def chart_raw(camera, white=0.85):
    """The 24-patch chart under D65, in four rows of six; white is this share of saturation in the first channel."""
    light = load_spectrum("illuminant-d65").at(NM)
    patches = np.stack([load_spectrum(name).at(NM) * light for name in CHART]).T.reshape(-1, 4, 6)
    cube = patches.repeat(PATCH_PX, 1).repeat(PATCH_PX, 2) * 1e-4
    image = SpectralImage(cube, NM, pitch_um=camera.pitch_um, quantity="irradiance")
    trial = expose(image, replace(camera, filters=()), Exposure(1e-4, camera.base_iso, noise=False))
    signal = (trial.numbers.max() - trial.dark_dn) / (trial.highest_dn - trial.dark_dn)
    return expose(image, camera, Exposure(1e-4 * white / signal, camera.base_iso, noise=False))


def chart_error(xyz):
    """CIEDE2000 of the chart's pictures from its own colours, with the exposure of its greys: array (24,).

    The picture (row, column, 3) is XYZ, and may lack some pixels at its edges.
    """
    margins = [(4 * PATCH_PX - xyz.shape[0]) // 2, (6 * PATCH_PX - xyz.shape[1]) // 2]
    quarter = PATCH_PX // 4
    corners = [np.array(patch) * PATCH_PX + quarter - margins for patch in np.ndindex(4, 6)]
    seen = np.array([xyz[down:down + 2 * quarter, right:right + 2 * quarter].mean(axis=(0, 1))
                     for down, right in corners])
    true, white = chart_xyz()
    exposure = (true[GREYS, 1] @ seen[GREYS, 1]) / (seen[GREYS, 1] @ seen[GREYS, 1])
    return ciede2000(lab_from_xyz(exposure * seen, white), lab_from_xyz(true, white))


def chart_xyz():
    """XYZ of the chart under D65, array (24, 3), and of white, with Y = 1."""
    light = colour_matching(FINE_NM) * load_spectrum("illuminant-d65").at(FINE_NM)[:, None]
    white = light.sum(axis=0)
    return np.stack([load_spectrum(name).at(FINE_NM) for name in CHART]) @ light / white[1], white / white[1]
