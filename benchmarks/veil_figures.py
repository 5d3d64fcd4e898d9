"""Veils and stars: the glare index of each cleanliness, spikes and energy of stars, and their cost.

    python benchmarks/veil_figures.py

prints for some lenses, wide open, the glare index of each cleanliness on a full frame, and the share of all light that
is scattered at 450 and 650 nm; then the index in the lens image of the chart for an index of 2.5 %. For a lens at f/8:
the light outside the window of its PSFs, by the bake and by `star_share`; and for some irises the number of spikes
around a lamp, the share of light in its star, the part of this in the frame, and how much brighter the spikes are than
the median around the lamp. Last, the processor seconds for 10 lamps at 1920 x 1080 px and 12 wavelengths.
"""

import time

import numpy as np
import scipy

from lensfield.engine import load_lens, simulate
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.spectral_image import SpectralImage
from lensfield.engine.lens.iris import Iris, opening_within
from lensfield.engine.rays.rings import Rings
from lensfield.engine.stray.arrivals import arrivals
from lensfield.engine.stray.star import add_stars, star_share
from lensfield.engine.stray.veil import (
    CLEANLINESS,
    add_veil,
    glare_chart,
    glare_index,
    index_in,
    veil_of,
    veil_with_index,
)

LENSES = "cooke-triplet-50mm", "nikkor-28mm", "tessar-50mm"
FRAME, COLOURS_NM = PixelGrid((360, 540), 36e3 / 540), np.array([450.0, 650.0])
IRISES = Iris(0), Iris(5), Iris(6, 10.0), Iris(7, 10.0), Iris(6, 10.0, 0.2)
FINE, LAMP_PX, RADIUS_PX = PixelGrid((720, 1080), 36e3 / 1080), (330, 500), 100
WAVELENGTHS_NM, FULL_HD = np.linspace(420, 680, 12), PixelGrid((1080, 1920), 36e3 / 1920)


def veil_line(name: str) -> str:
    """Glare indices, shares and the index that comes back."""
    lens, cells = load_lens(name, quality="preview"), []
    for cleanliness in CLEANLINESS:
        veil = veil_of(lens, cleanliness)
        cells.append(f"{glare_index(lens, FRAME, veil):8.2%} ({', '.join(f'{s:.2%}' for s in veil.share(COLOURS_NM))})")
    veil = veil_with_index(lens, FRAME, "dusty", 0.025)
    chart = glare_chart(lens, FRAME, np.array([veil.reference_nm]))
    image = simulate(chart, lens).cube * np.float32(1 - veil.share(veil.reference_nm))
    add_veil(image, FRAME, arrivals(chart, lens), veil)
    return f"{name:<24}{''.join(f'{cell:<26}' for cell in cells)}{index_in(image[0]):.3%}"


def star_line(lens, iris: Iris) -> str:
    """Spikes and energy of a lamp's star at 550 nm."""
    opening, nm = opening_within(iris, np.inf), np.array([550.0])
    plane = np.zeros(FINE.shape_px)
    plane[LAMP_PX] = 1e6
    light, cube = arrivals(SpectralImage(plane, nm, FINE), lens), np.zeros((1, *FINE.shape_px), np.float32)
    share = add_stars(cube, lens, opening, FINE, light)[0]
    azimuth = 2 * np.pi * np.arange(1440) / 1440
    ring = scipy.ndimage.map_coordinates(cube[0], [LAMP_PX[0] - RADIUS_PX * np.sin(azimuth),
                                                   LAMP_PX[1] + RADIUS_PX * np.cos(azimuth)], order=1)
    bright = ring > 0.1 * ring.max()
    return (f"{f'{iris.blades} blades, roundness {iris.roundness}':<28}{np.sum(bright & ~np.roll(bright, 1)):>6}"
            f"{share:>12.3%}{cube.sum() / light.light.sum():>12.3%}{ring.max() / np.median(ring):>14.3g}")


def costs(lens) -> str:
    """Processor seconds."""
    rng = np.random.default_rng(1)
    cube = rng.random((12, *FULL_HD.shape_px), np.float32)
    for row, column in zip(rng.integers(100, 980, 10), rng.integers(100, 1800, 10), strict=True):
        cube[:, row:row + 3, column:column + 3] += 1e5
    radiance, stray = SpectralImage(cube, WAVELENGTHS_NM, FULL_HD), np.zeros_like(cube)
    started = [time.process_time()]
    light = arrivals(radiance, lens)
    started.append(time.process_time())
    add_veil(stray, FULL_HD, light, veil_of(lens, "hazy"))
    started.append(time.process_time())
    for iris in (Iris(6, 10.0), Iris(6, 10.0, 0.2)):
        add_stars(stray, lens, opening_within(iris, np.inf), FULL_HD, light)
        started.append(time.process_time())
    parts = zip(("arriving light", "veil", "stars", "stars of rounded blades"), np.diff(started), strict=True)
    return ", ".join(f"{part} {seconds:.2f} s" for part, seconds in parts)


if __name__ == "__main__":
    print(f"{'lens':<24}{''.join(f'{name:<26}' for name in CLEANLINESS)}2.5 % put in")
    for each in LENSES:
        print(veil_line(each), flush=True)
    stopped = load_lens(LENSES[0], Rings(f_number=8.0), quality="preview")
    outside = 1 - stopped.enclosed_energy[:, 0].mean()
    shares = star_share(stopped, opening_within(Iris(0), np.inf), stopped.wavelengths_nm)
    print(f"\n{stopped.name} at f/8: outside the window {outside:.3%} by the bake, {shares.mean():.3%} as stars")
    print(f"{'iris':<28}{'spikes':>6}{'share':>12}{'in frame':>12}{'peak / median':>14}")
    for each in IRISES:
        print(star_line(stopped, each), flush=True)
    print(f"\n{costs(stopped)}")
