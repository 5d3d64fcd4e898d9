"""Draw two metamers as the eye and as a film see them: docs/film_metamers.png.

    python docs/figures/film_metamers.py docs/film_metamers.png

The stock is made up: layers with bell-shaped sensitivities, balanced for D55.
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from lensfield.engine import SpectralImage
from lensfield.engine.inspection.axes import Axis, Panel, labels_of
from lensfield.engine.inspection.canvas import DASHED, SOLID, Box, Page, Pen
from lensfield.engine.inspection.style import INK
from lensfield.engine.sensor.film import Film, film_exposure
from lensfield.engine.spectral.colour import XYZ_TO_REC709, encode_srgb
from lensfield.engine.spectral.spectra import colour_matching, load_spectrum, trapezoid_weights

NM = np.arange(380.0, 721.0, 5.0)
PEAKS_NM, WIDTH_NM = np.array([650.0, 550.0, 440.0]), 45.0
REFERENCE_J_PER_M2 = 0.1  # of D55, for the reference density of each layer
LABEL_PT, NAME_PT = 8, 9
MIDDLE, EDGE = 0.5, 0.04  # reflectance of both metamers without their difference, and the least


def daylight(nm):
    """Spectral density of D55 per nm."""
    return load_spectrum("illuminant-d55").density_at(nm)


def made_up_film():
    """A stock with bell-shaped sensitivities, for which D55 is neutral."""
    curves = -((NM - PEAKS_NM[:, None]) / WIDTH_NM)**2
    exposure = 10**curves @ (trapezoid_weights(NM) * REFERENCE_J_PER_M2 * daylight(NM))
    return Film("made up", ("red", "green", "blue"), NM, curves - np.log10(exposure)[:, None])


def metamers(film):
    """Two reflectances of the same colour under D55, as different as possible in the red layer: array (2, NM)."""
    weights = daylight(NM) * trapezoid_weights(NM)
    matching, red = (colour_matching(NM) * weights[:, None]).T, 10**film.log_sensitivity[0] * weights
    invisible = red - matching.T @ np.linalg.lstsq(matching.T, red, rcond=None)[0]
    return MIDDLE + np.array([[1], [-1]]) * (MIDDLE - EDGE) * invisible / abs(invisible).max()


def to_the_eye(reflectances):
    """Linear Rec. 709 of reflectances under D55, with D55 as white: array (reflectance, 3)."""
    matching = (colour_matching(NM) * (daylight(NM) * trapezoid_weights(NM))[:, None]).T
    rec709, white = (each @ matching.T @ XYZ_TO_REC709.T for each in (reflectances, np.ones((1, NM.size))))
    return rec709 / white


def on_film(reflectances, film):
    """Exposures of the layers by reflectances under D55, over the exposures by white: array (reflectance, layer)."""
    light = np.concatenate([reflectances, np.ones((1, NM.size))]) * daylight(NM)
    image = SpectralImage(light.T[:, None], NM, pitch_um=5.0, quantity="irradiance")
    exposure = film_exposure(image, film, shutter_s=REFERENCE_J_PER_M2)[:, 0].T
    return exposure[:-1] / exposure[-1]


def draw(path):
    """Write the picture."""
    film, page = made_up_film(), Page(8, 2.8, 110)
    pair = metamers(film)
    curves = Panel(page, Box(0.68, 0.55, 3.45, 2), Axis.around(NM, 0.05), Axis(0, 1))
    x_ticks, y_ticks = curves.x.ticks(8), curves.y.ticks(6)
    curves.dress(x_ticks, labels_of(x_ticks), y_ticks, labels_of(y_ticks), LABEL_PT)
    curves.name_axes("wavelength (nm)", "reflectance", NAME_PT)
    for reflectance, dashes in zip(pair, (SOLID, DASHED), strict=True):
        curves.curve(NM, reflectance, Pen(INK, 1.2, dashes))
    for left, colours, title in ((4.35, to_the_eye(pair), "to the eye"), (6.15, on_film(pair, film), "on film")):
        place = Box(left, 0.55, 1.65, 2)
        page.write(place.left + place.width / 2, place.top + 0.06, title, NAME_PT, across=0.5, up=0.0)
        for number, (name, colour) in enumerate(zip(("solid", "dashed"), encode_srgb(colours), strict=True)):
            half = place._replace(left=place.left + number * place.width / 2, width=place.width / 2)
            page.rectangle(half, colour)
            page.write(half.left + half.width / 2, half.bottom - 0.1, name, LABEL_PT, across=0.5)
        page.frame(place, INK, 0.8)
    Image.fromarray(page.pixels()).save(path)


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
