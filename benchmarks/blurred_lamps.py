"""Measure small lamps out of focus, without and with detail, against counted rays: misplaced light, and radius.

    python benchmarks/blurred_lamps.py [LENS[:F-NUMBER]@FOCUS_MM:LAMP_MM ...] [--width 384] [--lamps 1.6 3]

Square lamps on a black wall at LAMP_MM are imaged to places on the axis and outwards, off the middles of pixels.
`simulate` takes them as a layer of depth in its capture's pixels, with their even light and with detail of 2 x 2 parts.
They are compared with rays traced one by one from each lamp through all of the stop, at 550 nm: without layers,
look-ups and pixels. See LEGEND for the columns.
"""

import argparse
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from lensfield.engine import Lens, Options, Rings, load_lens, simulate
from lensfield.engine.depth.depth_range import blur_per_nearness_px
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.in_capture import from_capture
from lensfield.engine.field.overscan import choose_capture, columns_for_blur
from lensfield.engine.field.ray_blur import tangents
from lensfield.engine.image.detail import Detail, merged
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.entrance_pupil import focus_nearness
from lensfield.engine.lens.pinhole import fitting_pitch_um
from lensfield.engine.library.rays import lens_rays

CASES = ("zeiss-biotar-50mm:1.4@2000:6000", "panavision-21mm-1.3x@2000:3000", "olympus-fisheye-8mm@2000:250")
NM, ACCURACY, PARTS = 550.0, 3e-3, 2
FIELD, WAYS = (0.0, 0.3, 0.6, 0.85), (0.7, -0.4)  # of the half width, and of the half height for each of these
REACH_PX, BESIDE_PX = 40, 8  # of blur; around a lamp's image
RAYS, IN_LAMP = 2**13, 64  # through the stop, and from places of the lamp along each
NEWTON_STEPS, STEP_MM, WITHIN = 6, 1e-3, 0.999  # on the sensor, and share of the field that rays start in
FOUND = 1e-5  # of a tangent: other rays land beyond the field
LEGEND = """\
x, y    where the lamp's light lands
blur    of a point on the axis by the complete stop, in pixels
L1      misplaced light, relative to the lamp's
radius  of the disc, RMS, relative to the rays'"""


@dataclass(frozen=True)
class Scene:
    """A lens in front of a wall with lamps: where they are in the pixels of its capture, and about where they land.

    `places` are rows and columns of the capture in columns of the sensor, `landed_mm` x and y: arrays (2, lamp).
    """

    lens: Lens
    frame: PixelGrid
    capture: PixelGrid
    depth_mm: float
    side_px: float
    places: np.ndarray
    landed_mm: np.ndarray

    @classmethod
    def of(cls, lens, width_px, depth_mm, side_px):
        """Lamps in the frame of the lens's sensor, in two directions from the axis."""
        rows = 2 * round(width_px * lens.sensor_mm[1] / lens.sensor_mm[0] / 2)
        frame = PixelGrid((rows, width_px), fitting_pitch_um(lens, (rows, width_px)))
        capture = choose_capture(lens, frame, [NM], REACH_PX)
        half_mm = np.array([width_px, rows]) / 2 * frame.pitch_um * 1e-3
        landed_mm = np.array([[share, way * share] for share in FIELD for way in WAYS[:2 if share else 1]]).T
        landed_mm *= half_mm[:, None]
        lit = capture.index_of(*field_map(lens).at_wavelength(NM).source_mm(*landed_mm, capture))
        jitter = np.random.default_rng(5).random(landed_mm.shape) - 0.5
        return cls(lens, frame, capture, depth_mm, side_px, np.array(lit) + jitter, landed_mm)

    @property
    def blur_px(self):
        """The blur on the axis."""
        from_focus = 1 / self.depth_mm - focus_nearness(self.lens)
        return abs(from_focus) * blur_per_nearness_px(self.lens, self.frame.pitch_um)

    def layered(self, parts):
        """Its LayeredRadiance with a detail of `parts` x `parts`, drawn exactly."""
        columns = columns_for_blur(self.lens)
        down, across = (np.arange(parts * of * n + 1) / (parts * of) - 0.5
                        for n, of in zip(self.capture.shape_px, (1, columns), strict=True))
        light = np.zeros((1, down.size - 1, across.size - 1), np.float32)
        for row, column in self.places.T:
            light[0] += np.outer(lit_share(down, row, self.side_px), lit_share(across, column, self.side_px))
        cube, detail = merged(light, parts), Detail.of(light, [NM], parts) if parts > 1 else None
        shape = cube.shape[1:]
        return LayeredRadiance((Layer(cube, np.ones(shape), np.full(shape, self.depth_mm), detail=detail),), [NM],
                               self.capture.finer_across(columns))

    def tangents(self, rows, columns):
        """Tangents of angles to the right and up at places in the capture: array (2, place)."""
        x_mm, y_mm = from_capture(*self.capture.position_mm(rows, columns), self.lens, self.capture)
        return np.array([x_mm * self.lens.squeeze, y_mm]) / self.lens.capture_focal_length_mm


def lit_share(ends, middle, side):
    """The lit share of pixels between these ends."""
    return np.diff(np.clip(ends, middle - side / 2, middle + side / 2)) / np.diff(ends)


def sources_of(rays, at_mm, stop, depth_mm):
    """The tangents at a depth of points whose light lands at places of the upright picture, and the SensorRays."""
    traced = rays.rays(0, -at_mm, stop)
    return traced.entrance_mm / depth_mm - tangents(traced), traced


def landings_mm(scene, rays, lamp):
    """Where the light of a lamp lands: x and y, array (2, ray), and the light of each ray.

    Each ray from the lamp's middle is found by Newton's method; those from around it land as its slopes say.
    """
    sample = qmc.Sobol(2, seed=1).random(RAYS).T
    stop = np.sqrt(sample[0]) * np.array([np.cos(2 * np.pi * sample[1]), np.sin(2 * np.pi * sample[1])])
    middle = scene.places[:, lamp, None]
    wanted, at_mm = scene.tangents(*middle), np.repeat(scene.landed_mm[:, lamp, None], RAYS, axis=1)
    for _ in range(NEWTON_STEPS):
        source, traced = sources_of(rays, at_mm, stop, scene.depth_mm)
        slopes = [(sources_of(rays, at_mm + step, stop, scene.depth_mm)[0] - source) / STEP_MM
                  for step in STEP_MM * np.eye(2)[..., None]]
        per_tangent = np.linalg.inv(np.stack(slopes, axis=1).transpose(2, 0, 1))
        at_mm = rays.inside(at_mm + np.einsum("rij,jr->ir", per_tangent, wanted - source), WITHIN)
    shift, turns = np.random.default_rng(6).random((2, RAYS, 1)), qmc.Sobol(2, seed=2).random(IN_LAMP).T[:, None]
    around = middle[..., None] + scene.side_px * ((shift + turns) % 1 - 0.5)
    spread_mm = np.einsum("rij,jrn->irn", per_tangent, scene.tangents(*around) - wanted[..., None])
    lands = (traced.margin > 0) & (np.abs(wanted - source).max(axis=0) < FOUND)
    light = np.where(lands, traced.weight * np.abs(np.linalg.det(per_tangent)), 0)
    return (at_mm[..., None] + spread_mm).reshape(2, -1), np.repeat(light, IN_LAMP)


def counted(scene, rays, lamp):
    """The image of a lamp by its rays: array (row, column) of the frame, of unit sum."""
    places_mm, light = landings_mm(scene, rays, lamp)
    ends = [np.arange(n + 1) - 0.5 for n in scene.frame.shape_px]
    return np.histogram2d(*scene.frame.index_of(*places_mm), ends, weights=light)[0] / light.sum()


def radius_px(picture):
    """The RMS distance of light from its middle."""
    return np.sqrt(sum(np.average((axis - np.average(axis, weights=picture)) ** 2, weights=picture)
                       for axis in np.indices(picture.shape)))


def compared(picture, true):
    """Misplaced light, and the difference in radius, around the true image of a lamp."""
    around = tuple(slice(max(int(lit.min()) - BESIDE_PX, 0), int(lit.max()) + BESIDE_PX + 1)
                   for lit in np.nonzero(true))
    picture, true = (each[around] / each[around].sum() for each in (picture, true))
    return f"{np.abs(picture - true).sum():8.3f}{radius_px(picture) / radius_px(true) - 1:+9.1%}"


def lines(scene):
    """Yield a line for each lamp."""
    rays = lens_rays(scene.lens).at([NM])
    pictures = [simulate(scene.layered(parts), scene.lens, Options(accuracy=ACCURACY)).cube[0].astype(float)
                for parts in (1, PARTS)]
    for lamp, (x_mm, y_mm) in enumerate(scene.landed_mm.T):
        true = counted(scene, rays, lamp)
        yield (f"{x_mm:7.2f}{y_mm:7.2f}{scene.blur_px:7.2f}{scene.side_px:6.3g}"
               + "".join(compared(picture, true) for picture in pictures))


def case_of(text):
    """Lens and depth of a case."""
    text, _, depths = text.partition("@")
    (name, _, f_number), (focus_mm, depth_mm) = text.partition(":"), map(float, depths.split(":"))
    return load_lens(name, Rings(focus_mm, float(f_number) if f_number else None), "preview"), depth_mm


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("cases", nargs="*", default=CASES, metavar="LENS[:F-NUMBER]@FOCUS_MM:LAMP_MM")
    parser.add_argument("--width", type=int, default=384, help="of the frame on the lens's sensor, in pixels")
    parser.add_argument("--lamps", nargs="+", type=float, default=[3.0], help="their sides, in pixels")
    options = parser.parse_args()
    print(LEGEND)
    for case in options.cases:
        print(f"\n{case}, {options.width} px\n{'x mm':>7}{'y mm':>7}{'blur':>7}{'lamp':>6}"
              + 2 * f"{'L1':>8}{'radius':>9}")
        lens, depth_mm = case_of(case)
        for side_px in options.lamps:
            for line in lines(Scene.of(lens, options.width, depth_mm, side_px)):
                print(line, flush=True)


if __name__ == "__main__":
    main()
