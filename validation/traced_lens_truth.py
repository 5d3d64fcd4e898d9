"""Lensfield's complete chain against rays through the real lens, at one wavelength.

    python validation/traced_lens_truth.py [LENS ...]

renders beads, even light and a chequered plane at the lens's object distance twice: by `render_through_lens`, and by
the traced lens. It prints every figure with its limit. The exit status is 1 if a figure exceeds its limit.
"""

import os
import sys
import tempfile
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.ndimage

import truth_scenes
from lensfield import addon
from lensfield.addon.scene.camera import pitch_um
from lensfield.commands.terminal import quiet
from lensfield.engine import Options, load_lens
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.stray.options import OFF, StrayOptions
from traced_lens import photograph

WAVELENGTH_NM = 562.0
LENSES = "edmund-54852", "kodak-petzval-100mm"
FRAME_PX = 576, 768
BEADS = (0, 0), (0.15, 0.3), (0.33, 2.8), (0.5, 4.4), (0.62, 0.65), (0.75, 3.8), (0.8, 5.65)
"""Positions of beads: field heights as fractions of the last, and azimuths in radians."""
SPOTS = 0.2, 0.4, 0.6, 0.7, 0.8
OPTIONS = Options(accuracy=1e-4)  # a thousandth of the light at the window's edge contributes much to a mean square
GEOMETRY_RULES = 0.03  # geometry dominates if diffraction adds less than this to the mean square radius of a spot


@dataclass(frozen=True)
class Figure:
    """A measured figure and its limit; None for a figure without a limit."""

    what: str
    value: float
    limit: float | None
    unit: str = ""

    @property
    def missed(self):
        return self.limit is not None and not self.value <= self.limit

    def __str__(self):
        value, limit = (f"{part:.3f} px" if self.unit else f"{part:.2%}" for part in (self.value, self.limit or 0))
        verdict = "" if self.limit is None else f"  limit {limit}  {'MISSED' if self.missed else 'met'}"
        return f"  {self.what}: {value}{verdict}"


@dataclass(frozen=True)
class Spot:
    """One bead's image: its centroid relative to the axis, and RMS radius around the centroid."""

    centroid_um: np.ndarray
    rms_um: float


class Bench:
    """A lens on the bench, and the two ways to take a picture through it."""

    def __init__(self, name, quality="standard"):
        self.lens = load_lens(name, quality=quality)
        self.optics = self.lens.at_wavelength(WAVELENGTH_NM)

    def lensfield(self, scene, shape_px, samples, options=OPTIONS, depth="off"):
        """Spectral irradiance by Lensfield: array (row, column) of a frame that fits in the sensor."""
        scene.render.resolution_y, scene.render.resolution_x = shape_px
        scene.cycles.samples = samples
        with tempfile.TemporaryDirectory() as folder:
            with quiet(1):  # suppresses Blender's messages about saved passes
                result = addon.render_through_lens(scene, lens=self.lens, wavelengths_nm=[WAVELENGTH_NM],
                                                   output_folder=folder, options=options, depth=depth,
                                                   stray=StrayOptions(OFF))
            return read_exr(result.irradiance).cube[0].astype(float)

    def traced(self, scene, shape_px, samples, seed=0, part=None):
        """Spectral irradiance by the traced lens: array (row, column) of a frame that fits the sensor, or a part."""
        return photograph(scene, self.lens, WAVELENGTH_NM, shape_px, samples=samples, seed=seed, part=part)[0]

    def real_mm(self, paraxial_mm):
        """Intersection of the chief rays of points (…, 2) with the sensor, from the lens data."""
        height = np.linalg.norm(paraxial_mm, axis=-1, keepdims=True)
        real = np.interp(height, self.optics.heights_mm, self.optics.real_height_mm)
        return np.asarray(paraxial_mm) * np.divide(real, height, out=np.ones_like(real), where=height > 0)


def patches_about(places_mm, frame, half_px):
    """Patches of a frame's pixels around positions: list of (rows, columns)."""
    (row, column), px_per_mm = frame.centre_px, 1e3 / frame.pitch_um
    middles = ((round(row - y_mm * px_per_mm), round(column + x_mm * px_per_mm)) for x_mm, y_mm in places_mm)
    return [tuple(slice(middle - half_px, middle + half_px + 1) for middle in place) for place in middles]


def spot(picture, frame, patch, radius_um):
    """The Spot in a picture of a frame's patch, from the light in a circle around the patch's middle."""
    x, y = (1e3 * place[patch] for place in places_mm(frame))
    within = np.hypot(x - x.mean(), y - y.mean()) <= radius_um
    light = picture * within
    place = np.array([np.average(x, weights=light), np.average(y, weights=light)])
    rms = np.sqrt(np.average((x - place[0])**2 + (y - place[1])**2, weights=light))
    return Spot(place, rms)


def places_mm(frame):
    """Positions of a frame's pixels: x and y from the axis, arrays (row, column)."""
    return np.meshgrid(*frame.axes_mm())


def bead_spots(bench, paraxial_mm, *, shape_px, bead_px, half_px, samples):
    """Spots of beads with their ideal images at (bead, 2) mm: list of (by Lensfield, by the traced lens)."""
    frame = frame_of(bench.lens, shape_px)
    scene = truth_scenes.empty_scene()
    truth_scenes.add_beads(scene, bench.lens, paraxial_mm, bead_px * frame.pitch_um)
    picture = bench.lensfield(scene, shape_px, samples[0])
    radius_um = (half_px + 0.5) * frame.pitch_um
    return [(spot(picture[patch], frame, patch, radius_um),
             spot(bench.traced(scene, shape_px, samples[1], part=patch), frame, patch, radius_um))
            for patch in patches_about(bench.real_mm(paraxial_mm), frame, half_px)]


def added_variance_um2(lens, pitch, radius_um):
    """Contributions to the mean square radius of Lensfield's spots in addition to geometry: (diffraction, sampling).

    In an Airy pattern, the share of light beyond r is 2 lambda N / (pi^2 r), so its mean square radius grows with the
    window: 2 lambda N R / pi^2. This also applies to aberrated pupils, because it is an effect of their edge. Squares
    of side a that represent points add a^2 / 6 each: pixels of the capture, their footprints on the sensor's grid, and
    samples of the PSF.
    """
    diffraction = 2 * WAVELENGTH_NM * 1e-3 * lens.f_number_effective * radius_um / np.pi**2
    return diffraction, (2 * pitch**2 + lens.psf_pitch_um**2) / 6


def distortion_figures(bench, beads=BEADS, shape_px=FRAME_PX, samples=(32, 128)):
    """Centroids of beads distributed over the frame."""
    places = bench.lens.heights_mm[-1] * np.array([(height * np.cos(azimuth), height * np.sin(azimuth))
                                                   for height, azimuth in beads])
    spots = bead_spots(bench, places, shape_px=shape_px, bead_px=2, half_px=12, samples=samples)
    away_px = [np.hypot(*(ours.centroid_um - true.centroid_um)) / pitch_um(bench.lens, shape_px)
               for ours, true in spots]
    return [Figure(f"distortion: centroids of {len(spots)} beads, largest difference", max(away_px), 0.3, "px")]


def spot_figures(bench, heights=SPOTS, columns=3840, samples=(64, 512)):
    """Centroid and RMS radius of spots along a strip of the sensor, in the window of the lens's PSFs."""
    lens, pitch = bench.lens, 1e3 * bench.lens.sensor_mm[0] / columns
    half_px = int(lens.psf_pitch_um * lens.psf.shape[-1] / 2 / pitch)
    radius_um = (half_px + 0.5) * pitch
    places = np.stack([heights, np.zeros(len(heights))], axis=1) * lens.heights_mm[-1]
    spots = bead_spots(bench, places, shape_px=(2 * half_px + 41, columns), bead_px=2, half_px=half_px,
                       samples=samples)
    diffraction, sampling = added_variance_um2(lens, pitch, radius_um)
    figures = []
    for height, (ours, true) in zip(heights, spots, strict=True):
        where = f"spot at {height:g} of the field"
        away_um = np.hypot(*(ours.centroid_um - true.centroid_um))
        geometric_um = np.sqrt(ours.rms_um**2 - diffraction - sampling)
        figures += [Figure(f"{where}: difference of centroids, over the RMS radius", away_um / true.rms_um, 0.05),
                    Figure(f"{where}: RMS radius {geometric_um:.2f} um without diffraction and sampling, traced "
                           f"{true.rms_um:.2f} um", abs(geometric_um / true.rms_um - 1), 0.05)]
        rules = diffraction < GEOMETRY_RULES * true.rms_um**2
        figures.append(Figure(f"{where}: RMS radius {ours.rms_um:.2f} um within {radius_um:.0f} um, "
                              f"{diffraction / true.rms_um**2:.1%} of its square from diffraction",
                              abs(ours.rms_um / true.rms_um - 1), 0.05 if rules else None))
    return figures


def illumination_figures(bench, columns=96, samples=256, rings=10):
    """Irradiance of even light, in rings around the axis."""
    scene, frame = truth_scenes.empty_scene(), full_frame(bench.lens, columns)
    truth_scenes.set_even_light(scene, 1.0)
    ours, true = bench.lensfield(scene, frame.shape_px, 4), bench.traced(scene, frame.shape_px, samples)
    height = np.hypot(*places_mm(frame)) / bench.optics.real_height_mm[-1]
    edges = np.sqrt(np.linspace(0, min(1, height.max()), rings + 1))  # of even area
    ratio = np.array([ours[ring].sum() / true[ring].sum()
                      for ring in ((height >= low) & (height < high) for low, high in pairwise(edges))])
    return [Figure(f"even light: irradiance, {rings} rings, largest difference", abs(ratio - 1).max(), 0.01),
            Figure("even light: relative illumination, the same", abs(ratio / ratio[0] - 1).max(), 0.01)]


def chequer_figures(bench, columns=384, samples=(64, 64), square_px=12, block_px=48):
    """Light and dark squares all over the frame: the difference of the pictures, and their shifts by blocks."""
    scene, frame = truth_scenes.empty_scene(), full_frame(bench.lens, columns)
    truth_scenes.add_chequer(scene, bench.lens, 1.3 * bench.lens.heights_mm[-1], square_px * frame.pitch_um * 1e-3)
    ours = bench.lensfield(scene, frame.shape_px, samples[0])
    first, second = (bench.traced(scene, frame.shape_px, samples[1], seed) for seed in (0, 1))
    within = np.hypot(*places_mm(frame)) < bench.optics.real_height_mm[-1]
    shifts = [np.hypot(*shift_px(first[block] + second[block], 2 * ours[block]))
              for block in blocks(frame.shape_px, block_px) if within[block].all()]

    def apart(picture):  # the noise of two pictures does not correlate
        product = ((picture - first) * (picture - second))[within].sum()
        return np.sqrt(max(product, 0) / (first * second)[within].sum())

    displaced = apart(scipy.ndimage.shift(ours, (0, 0.3), order=3, mode="nearest"))
    light = ours[within].sum() / first[within].sum()
    return [Figure(f"chequer: shift, {len(shifts)} blocks of {block_px} px, the largest", max(shifts), 0.3, "px"),
            Figure("chequer: relative L2 difference; limit: that of a shift by 0.3 px", apart(ours), displaced),
            Figure("chequer: total light", abs(light - 1), 0.01)]


def full_frame(lens, columns):
    """The PixelGrid of the complete sensor, with this number of columns."""
    return frame_of(lens, (round(columns * lens.sensor_mm[1] / lens.sensor_mm[0]), columns))


def frame_of(lens, shape_px):
    """The PixelGrid of a frame that fits in the sensor."""
    return PixelGrid(shape_px, pitch_um(lens, shape_px))


def blocks(shape_px, side_px):
    """Slices that tile a picture, except for a remainder at its ends."""
    return [(slice(row, row + side_px), slice(column, column + side_px))
            for row in range(0, shape_px[0] - side_px + 1, side_px)
            for column in range(0, shape_px[1] - side_px + 1, side_px)]


def shift_px(picture, template):
    """Shift of a picture relative to a template, down and to the right, from its slopes, with free brightness."""
    slopes = [-part.ravel() for part in np.gradient(template)]
    fitted = np.linalg.lstsq(np.stack([*slopes, template.ravel()], axis=1), picture.ravel(), rcond=None)[0]
    return fitted[:2] / fitted[2]


def main(names):
    missed = 0
    addon.register()
    for name in names or LENSES:
        bench = Bench(name)
        print(f"\n{name} at {WAVELENGTH_NM:g} nm: Lensfield against the traced lens")
        for measure in (distortion_figures, spot_figures, illumination_figures, chequer_figures):
            for figure in measure(bench):
                print(figure)
                missed += figure.missed
    return 1 if missed else 0


if __name__ == "__main__":
    status = main(sys.argv[1:])
    sys.stdout.flush()
    os._exit(status)  # some of Blender's wheels crash while the interpreter exits
