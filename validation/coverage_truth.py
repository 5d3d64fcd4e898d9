"""Coverage masks of renders, compared with rays from all of the stop, traced through the lens's surfaces to the scene.

    python validation/coverage_truth.py [docs/truth.md]

The scenes are those of `ground_truth.py` in unit, shift and pose: cards that hide each other, of which the nearest is
out of focus, through a lens with barrel distortion, an anamorphic lens and a fisheye. Rays through random places of the
stop, in all directions, land on the sensor as densely as even light does. The shares of those that meet a card, among
all in a block of pixels, are its coverage. With a page, the script writes its table there. It exits with status 1 if a
figure exceeds its limit.
"""

import re
import sys
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np
import scipy
from mathutils import Matrix

import truth_scenes
from ground_truth import COST_RUNS, COST_SAMPLES, FRAME_PX, SAMPLE_SCENE, UNIT_M, Bench, compare, place
from lensfield import addon
from lensfield.engine.depth.depth_range import blur_per_nearness_px
from lensfield.engine.inspection.curves import reference_nm
from lensfield.engine.pictures.spectral_exr import read_exr, read_parts
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.trace import trace_both_ways

BLUR_PX = 10.0  # of the nearest card
RAYS, AT_ONCE = 2**24, 2**20
BLOCK_PX = 4
FARTHER_SLOPES = 1.3  # than those of chief rays
TABLE = re.compile(r"(?<=<!-- coverage -->\n).*?(?=\n<!-- end -->)", re.DOTALL)
LIMIT, LIMIT_RMS, LIMIT_OF_LIGHT = 0.1, 0.01, 0.01
LEFT_OUT = "Twig", "Cord", "Filaments", "Stars"  # of the sample scene: 32 objects remain
EMISSIONS = {"Near": 3.0, "Hidden": 0.5, "Far": 1.5, "Background": 1.0}


class Card:
    """A rectangle that faces the camera and is turned about the axis.

    Parameters
    ----------
    name : str
    distance_m : float
    middle, size : (float, float)
        In tangents from the axis, to the right and up.
    turn_rad : float
    """

    def __init__(self, name, distance_m, middle, size, turn_rad):
        self.name, self.distance_m = name, distance_m
        self._middle_m, self._half_m = distance_m * np.array(middle), distance_m * np.array(size) / 2
        self._turn = np.array(Matrix.Rotation(turn_rad, 3, "Z"))

    def add(self, scene):
        corners = self._half_m / UNIT_M * [(-1, -1), (1, -1), (1, 1), (-1, 1)]
        mesh = bpy.data.meshes.new(self.name)
        mesh.from_pydata(np.pad(corners, ((0, 0), (0, 1))).tolist(), [], [(0, 1, 2, 3)])
        mesh.materials.append(truth_scenes.glow(self.name))
        place(scene, self.name, mesh, (*self._middle_m, -self.distance_m), self._turn, 0)

    def met(self, origins_m, directions):
        """Whether rays meet the card: arrays (3, ray)."""
        along = (-self.distance_m - origins_m[2]) / directions[2]
        points_m = (origins_m + along * directions)[:2].T - self._middle_m
        return np.all(np.abs(points_m @ self._turn[:2, :2]) < self._half_m, axis=1)


def cards_of(bench):
    """A near card; one behind it, most of which only the rim of the lens sees; and one far away, in focus."""
    near_m = blur_per_nearness_px(bench.lens, bench.frame.pitch_um) / BLUR_PX * 1e-3
    half = bench.lens.sensor_mm[1] / 2 / bench.lens.capture_focal_length_mm
    return [Card("Near", near_m, (-0.1 * half, 0.1 * half), (0.7 * half, 0.6 * half), 0.3),
            Card("Hidden", 2 * near_m, (0.15 * half, 0.15 * half), (0.7 * half, 0.56 * half), 0.3),
            Card("Far", 100 * near_m, (0.4 * half, -0.2 * half), (0.6 * half, 0.9 * half), -0.2)]


def traced(bench, cards):
    """Coverage of blocks of the frame by cards, and last by the background: array (card + 1, row, column)."""
    lens, system = bench.lens, system_of(bench.lens.prescription)
    indices = system.indices_at([reference_nm(lens)])[:, :, None]
    chosen = scipy.stats.qmc.Sobol(4, seed=1)
    shape = tuple(n // BLOCK_PX for n in FRAME_PX)
    light = np.zeros((len(cards) + 1, *shape))
    ends = FARTHER_SLOPES * bench.slopes
    for _ in range(RAYS // AT_ONCE):
        stop, slopes = np.split(2 * chosen.random(AT_ONCE).T - 1, 2)
        stop, slopes = stop * system.stop_semi_aperture_mm, slopes * ends[:, None]
        with np.errstate(all="ignore"):
            rays = trace_both_ways(system.prescription, indices, *stop[:, None], *slopes[:, None])
            row, column = bench.frame.index_of(*-rays.position[:2, 0])
            passes = np.all(system.limits(rays.square_mm2[:, 0]) <= 1, axis=0) & np.isfinite(row + column)
            passes &= np.hypot(*stop) <= system.stop_semi_aperture_mm
            passes &= (row > -0.5) & (row < FRAME_PX[0] - 0.5) & (column > -0.5) & (column < FRAME_PX[1] - 0.5)
        entry, before = rays.entry[:, 0, passes], rays.before[:, 0, passes]
        origins_m = (entry - np.array([[0], [0], [lens.entrance_pupil_mm]])) * 1e-3
        what = np.full(passes.sum(), len(cards))
        for number, card in reversed(list(enumerate(cards))):
            what[card.met(origins_m, before)] = number
        block = [np.rint(at[passes]).astype(int) // BLOCK_PX for at in (row, column)]
        cosine_4 = (1 + np.sum(slopes[:, passes] ** 2, axis=0)) ** -2
        np.add.at(light, (what, *block), cosine_4)
    return light / light.sum(axis=0)


def render(bench, cards, strengths, truth):
    """A lens image at the reference wavelength, and its masks."""
    scene = bench.scene()
    for card in cards:
        card.add(scene)
        nodes = bpy.data.materials[card.name].node_tree.nodes
        nodes["Emission"].inputs["Strength"].default_value = strengths[card.name]
    truth_scenes.set_even_light(scene, strengths["Background"])
    scene.cycles.samples = COST_SAMPLES
    with tempfile.TemporaryDirectory() as folder:
        result = addon.render_through_lens(
            scene, frame=1, lens=bench.name, lens_quality="preview", focus=np.inf, truth=truth, files="irradiance",
            wavelengths_nm=(reference_nm(bench.lens),), output_folder=Path(folder))
        irradiance = read_exr(result.irradiance).cube[0].copy()
        (_, channels), = read_parts(result.truth) if truth else [("", {})]
    return irradiance, {name.split(".")[-2].removeprefix("Coverage "): plane for name, plane in channels.items()}


def figures(name):
    """(text, value, limit) of all figures of a lens."""
    bench = Bench(name)
    cards = cards_of(bench)
    light, masks = render(bench, cards, EMISSIONS, "coverage")
    white, _ = render(bench, cards, dict.fromkeys(EMISSIONS, 1.0), "")
    names = [*(card.name for card in cards), "Background"]
    shown = np.array([masks[each] for each in names])
    blocks = shown.reshape(len(names), FRAME_PX[0] // BLOCK_PX, BLOCK_PX, -1, BLOCK_PX).mean(axis=(2, 4))
    apart = np.abs(blocks - traced(bench, cards))
    made = np.tensordot([EMISSIONS[each] for each in names], shown, 1)
    known = np.isfinite(apart[0])
    yield "sum of all masks: largest difference from 1", np.abs(shown.sum(axis=0) - 1).max(), 1e-5
    for each, of_mask in zip(names, apart, strict=True):
        yield f"{each.lower()}: root mean square", np.sqrt(np.mean(of_mask[known] ** 2)), LIMIT_RMS
        yield f"{each.lower()}: largest", of_mask[known].max(), LIMIT
    yield ("light of the picture and of its masks: root mean square",
           np.sqrt(np.mean((made - light / white) ** 2)) / np.ptp([*EMISSIONS.values()]), LIMIT_OF_LIGHT)


def cost():
    """Processor seconds of the sample scene, without coverage, and with that of its objects."""
    bpy.ops.wm.open_mainfile(filepath=str(SAMPLE_SCENE))
    scene = bpy.context.scene
    scene.render.resolution_y, scene.render.resolution_x, scene.render.resolution_percentage = *FRAME_PX, 100
    scene.cycles.samples, scene.cycles.device = COST_SAMPLES, "CPU"
    for obj in scene.objects:
        obj.hide_render |= obj.name.startswith(LEFT_OUT)

    def seconds(products):
        with tempfile.TemporaryDirectory() as folder:
            begin = time.process_time()
            result = addon.render_through_lens(scene, frame=1, lens="tessar-50mm", lens_quality="preview",
                                               truth=products, output_folder=Path(folder))
            taken = time.process_time() - begin
            return taken, len(read_parts(result.truth)[0][1]) - 1 if products else 0

    seconds("coverage")  # fills the caches
    (without, _), (with_masks, objects) = np.median([(seconds(""), seconds("coverage")) for _ in range(COST_RUNS)],
                                                    axis=0)
    return (f"The sample scene, {FRAME_PX[1]} \u00d7 {FRAME_PX[0]} px, {COST_SAMPLES} samples, all of it out of focus, "
            f"takes {without:.1f} processor seconds without coverage, and {with_masks:.1f} with that of {objects:.0f} "
            f"objects: {100 * (with_masks / without - 1):.0f} % more (medians of {COST_RUNS}).")


if __name__ == "__main__":
    compare(figures, cost, TABLE, sys.argv[1:])
