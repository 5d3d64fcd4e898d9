"""Stray light: ghosts, veils and stars, and their processor seconds."""

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy
from cases import HD
from timing import machine, without_cache

from lensfield.engine import load_lens, simulate
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.sources import Sources
from lensfield.engine.image.spectral_image import SpectralImage
from lensfield.engine.lens.iris import Iris, opening_within
from lensfield.engine.library import prescription_of
from lensfield.engine.rays.rings import Rings, turned
from lensfield.engine.stray.arrivals import arrivals
from lensfield.engine.stray.ghosts import Ghosts, direct_light
from lensfield.engine.stray.ghosts import ghosts as ghosts_of
from lensfield.engine.stray.options import PARTS, StrayOptions
from lensfield.engine.stray.star import add_stars, star_share
from lensfield.engine.stray.stray_light import stray_light
from lensfield.engine.stray.veil import (
    CLEANLINESS,
    add_veil,
    glare_chart,
    glare_index,
    index_in,
    veil_of,
    veil_with_index,
)

FRAME, COLOURS_NM = PixelGrid((360, 540), 36e3 / 540), np.array([450.0, 650.0])
IRISES = Iris(0), Iris(5), Iris(6, 10.0), Iris(7, 10.0), Iris(6, 10.0, 0.2)
FINE, LAMP_PX, RADIUS_PX = PixelGrid((720, 1080), 36e3 / 1080), (330, 500), 100
WAVELENGTHS_NM, FULL_HD = np.linspace(420, 680, 12), PixelGrid(HD, 36e3 / HD[1])
LAMPS, FARTHEST_DEG, SPIRAL_RAD, F_NUMBER, BLADES = 10, 24.0, 0.65, 4.0, 7
COATING, NM, LAMP_SIDE_PX, LAMP, GROUND = "multi", np.linspace(400, 700, 12), 6, 1e4, 1.0  # radiances


def ghosts(lenses=("cooke-triplet-50mm", "pentax-macro-200mm", "arri-master-prime-100mm")) -> Iterator[str]:
    """The cost of ghosts, and how much of their light is drawn.

    Processor seconds for ten lamps in and around a picture at 1080p with 12 wavelengths, through lenses with bare
    surfaces at f/4; the pairs of surfaces; the ghosts that are drawn, of all lamps; and their light, as a share of the
    light of all ghosts and of the lamps' images. The goal is 6 s for a lens of 12 elements.
    """
    without_cache()
    yield machine()
    yield f"{'processor seconds':<26}{'':>10}{'pairs':>7}{'ghosts':>8}{'of all':>11}{'of images':>11}"
    for name in lenses:
        yield ghost_line(name)


def lamps() -> Sources:
    """Points at infinity on a spiral."""
    angle, azimuth = np.radians(np.linspace(2, FARTHEST_DEG, LAMPS)), SPIRAL_RAD * np.arange(LAMPS)
    directions = np.stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)], axis=1)
    return Sources(directions, np.full(LAMPS, np.inf), np.ones((LAMPS, WAVELENGTHS_NM.size)),
                   WAVELENGTHS_NM, np.zeros(LAMPS),
                   tuple(f"lamp {number}" for number in range(1, LAMPS + 1)))


def traced(name: str) -> tuple[Ghosts, np.ndarray, float]:
    """The ghosts of the lamps through a lens, the light of their images, and processor seconds of the ghosts."""
    design = prescription_of(name)
    bare = replace(design, coating="none", surfaces=tuple(replace(each, coating="") for each in design.surfaces))
    lens = turned(bare, Rings(f_number=F_NUMBER)).prescription
    before = time.process_time()
    opening = opening_within(Iris(BLADES), lens.stop_rim)
    found = ghosts_of(lens, lamps(), FULL_HD, opening)
    seconds = time.process_time() - before
    return found, direct_light(lens, lamps(), opening), seconds


def ghost_line(name: str) -> str:
    """A lens's line of the table."""
    found, images, seconds = traced(name)
    drawn, image = np.nansum(found.light), images.sum()
    count = np.count_nonzero(np.isfinite(found.light[:, :, 0]))
    return (f"{name:<26}{seconds:8.1f} s{len(found.pairs):7d}{count:8d}"
            f"{100 * drawn / (drawn + found.neglected.sum()):9.2f} %{100 * drawn / image:9.3f} %")


def veil(lenses=("cooke-triplet-50mm", "nikkor-28mm", "tessar-50mm")) -> Iterator[str]:
    """Veils and stars: the glare index of each cleanliness, spikes and energy of stars, and their cost.

    For lenses wide open, the glare index of each cleanliness on a full frame, and the share of all light that is
    scattered at 450 and 650 nm; then the index in the lens image of the chart for an index of 2.5 %. For the first lens
    at f/8: the light outside the window of its PSFs, by the bake and by `star_share`; and for some irises the number of
    spikes around a lamp, the share of light in its star, the part of this in the frame, and how much brighter the
    spikes are than the median around the lamp. Last, the processor seconds for 10 lamps at 1920 x 1080 px and 12
    wavelengths.
    """
    yield f"{'lens':<24}{''.join(f'{name:<26}' for name in CLEANLINESS)}2.5 % put in"
    for name in lenses:
        yield veil_line(name)
    stopped = load_lens(lenses[0], Rings(f_number=8.0), quality="preview")
    outside = 1 - stopped.enclosed_energy[:, 0].mean()
    shares = star_share(stopped, opening_within(Iris(0), np.inf), stopped.wavelengths_nm)
    yield f"\n{stopped.name} at f/8: outside the window {outside:.3%} by the bake, {shares.mean():.3%} as stars"
    yield f"{'iris':<28}{'spikes':>6}{'share':>12}{'in frame':>12}{'peak / median':>14}"
    for iris in IRISES:
        yield star_line(stopped, iris)
    yield f"\n{costs(stopped)}"


def veil_line(name: str) -> str:
    """Glare indices, shares and the index that comes back."""
    lens, cells = load_lens(name, quality="preview"), []
    for cleanliness in CLEANLINESS:
        each = veil_of(lens, cleanliness)
        cells.append(f"{glare_index(lens, FRAME, each):8.2%} ({', '.join(f'{s:.2%}' for s in each.share(COLOURS_NM))})")
    dusty = veil_with_index(lens, FRAME, "dusty", 0.025)
    chart = glare_chart(lens, FRAME, np.array([dusty.reference_nm]))
    image = simulate(chart, lens).cube * np.float32(1 - dusty.share(dusty.reference_nm))
    add_veil(image, FRAME, arrivals(chart, lens), dusty)
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


def stray(lens: str = "nikkor-50mm-f1.2") -> Iterator[str]:
    """Processor seconds of stray light: ten lamps in a 1080p picture of 12 wavelengths."""
    coated = load_lens(lens, Rings(f_number=F_NUMBER, coating=COATING), "preview")
    light, elements = lamps_on_ground(coated), sum(bool(surface.glass) for surface in coated.prescription.surfaces)
    yield f"{lens}: {elements} elements, {LAMPS} lamps, {HD[1]} x {HD[0]} px, {NM.size} wavelengths"
    for parts in (*PARTS, ",".join(PARTS)):
        start = time.process_time()
        found = stray_light(light, coated, StrayOptions(parts), 0.01, iris=Iris(6))
        yield f"{parts:<18} {time.process_time() - start:5.1f} processor seconds; {found.sources} sources of ghosts"


def lamps_on_ground(lens):
    cube = np.full((NM.size, *HD), GROUND, np.float32)
    for row, column in np.random.default_rng(1).integers(0, np.array(HD) - LAMP_SIDE_PX, (LAMPS, 2)):
        cube[:, row:row + LAMP_SIDE_PX, column:column + LAMP_SIDE_PX] = LAMP
    return SpectralImage(cube, NM, pitch_um=lens.sensor_mm[0] / HD[1] * 1e3,
                         focal_mm=lens.capture_focal_length_mm)
