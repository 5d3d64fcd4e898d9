"""Ground truth of renders, compared with what geometry says: rays through the lens's surfaces, met with the scene.

    python validation/ground_truth.py [docs/truth.md]

Five scenes, through a lens with barrel distortion, an anamorphic lens and a fisheye: a tilted board of squares, a floor
that recedes, a moving ball before a moving camera, the background of a camera that turns, and 200 balls. Scenes are in
centimetres; the camera is neither at the origin nor upright, and its Shift moves the axis off the middle of the frame.
With a page, the script writes its
tables there. It exits with status 1 if a figure exceeds its limit.
"""

import os
import re
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
import scipy.interpolate
from mathutils import Euler, Matrix, Vector

import truth_scenes
from lensfield import addon
from lensfield.addon.job.job import job_of
from lensfield.addon.scene.camera import frame_grid
from lensfield.engine.field.field_map import field_map
from lensfield.engine.inspection.curves import reference_nm
from lensfield.engine.pictures.spectral_exr import read_parts
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.trace import trace_both_ways
from lensfield.engine.truth.captured_truth import OBJECT, ShownObject
from lensfield.engine.truth.coco import annotations_of
from lensfield.engine.truth.cryptomatte import id_of
from lensfield.request import TRUTH

LENSES = {"edmund-54852": "barrel", "jacobsen-41mm-2x": "anamorphic", "pentax-fisheye-17mm": "fisheye"}
FRAME_PX = 144, 192
SAMPLE_SCENE = Path(__file__).resolve().parents[1] / "sample_scenes" / "evening_chess.blend"
COST_SAMPLES, COST_RUNS = 64, 3
OF_CHIEF_RAYS = [name for name in TRUTH if not name.endswith("coverage")]
UNIT_M = 0.01
SHIFT = 0.06, -0.04
PLACE, TURN = Vector((120.0, -80.0, 45.0)), Euler((1.2, 0.25, 0.7))  # of the camera, in centimetres and radians
NEWTON_STEPS, SLOPE_STEP, CONVERGED, LONGEST = 5, 1e-7, 1e-6, 1.05
BALLS, SEED = 200, 5
TABLE = re.compile(r"(?<=<!-- figures -->\n).*?(?=\n<!-- end -->)", re.DOTALL)
WHEN = {-1: "back", 1: "ahead"}
SKY_TURN = 0.03, -0.05, 0.02  # of the camera in a frame, in radians
AT_EDGE_PX = 0.75  # half the diagonal of a pixel, and a little for the difference of the grids


class ChiefRays:
    """Rays through the middle of a lens's stop, traced through its surfaces."""

    def __init__(self, lens, farthest_mm):
        self._system = system_of(lens.prescription)
        self._indices = self._system.indices_at([reference_nm(lens)])[:, :, None]
        slopes = np.linspace(0, 1.5, 3001)
        ends = []
        for axis in np.eye(2):
            image_mm = np.hypot(*self._trace(slopes[:, None] * axis)[0].T)
            rises = np.append(np.diff(image_mm) > 0, False) & (image_mm < 1.2 * farthest_mm)
            ends.append(slopes[np.argmin(rises)])
        steps = np.linspace(-1, 1, 101)
        self.ends = np.array(ends)
        self._slopes = np.stack(np.meshgrid(*(end * steps for end in ends)), axis=-1).reshape(-1, 2)
        known = self._trace(self._slopes)
        valid = np.all(np.isfinite(known), axis=(0, 2)) & (np.hypot(*known[0].T) < 1.2 * farthest_mm)
        self._slopes, self._known = self._slopes[valid], [each[valid] for each in known]

    def _trace(self, slopes):
        """Places on the sensor in mm, as the upright picture shows them, and tangents in front of the lens, to the
        right and up: arrays (ray, 2)."""
        nothing = np.zeros((1, len(slopes)))
        with np.errstate(all="ignore"):
            rays = trace_both_ways(self._system.prescription, self._indices, nothing, nothing, *slopes.T[:, None])
        return -rays.position[:2, 0].T, (-rays.before[:2, 0] / rays.before[2, 0]).T

    def matching(self, targets, of):
        """The tangents of rays to places on the sensor (`of` 0), or the places of rays with these tangents (1): arrays
        (..., 2). NaN for rays that the lens does not have."""
        flat = targets.reshape(-1, 2)
        slopes = scipy.interpolate.LinearNDInterpolator(self._known[of], self._slopes)(flat)
        for _ in range(NEWTON_STEPS):
            here = self._trace(slopes)[of]
            along = np.stack([(self._trace(slopes + SLOPE_STEP * axis)[of] - here) / SLOPE_STEP for axis in np.eye(2)],
                             axis=-1)
            good = np.isfinite(along).all(axis=(1, 2))
            slopes[good] -= np.linalg.solve(along[good], (here - flat)[good][..., None])[..., 0]
        traced = self._trace(slopes)
        lost = (np.abs(traced[of] - flat) > CONVERGED) | (np.abs(slopes) > LONGEST * self.ends)
        return np.where(lost.any(axis=1)[:, None], np.nan, traced[1 - of]).reshape(targets.shape)


class Bench:
    """A lens and its frame.

    Attributes
    ----------
    frame : PixelGrid
    rays : array (row, column, 3)
        Unit vectors of the pixels' chief rays, in the camera's axes.
    around : list of such arrays
        At AT_EDGE_PX from the pixels' middles.
    known : bool array (row, column)
        Whether the lens data cover a pixel.
    slopes : array (2,)
        Of the outermost chief rays at the stop, along x and y.
    """

    def __init__(self, name):
        self.name = name
        scene = self.scene()
        self.lens = job_of(scene, lens=name, lens_quality="preview", focus=np.inf).lens
        self.frame = frame_grid(scene, self.lens)
        self._chief = ChiefRays(self.lens, self.frame.farthest_px * self.frame.pitch_um * 1e-3)
        self.slopes = self._chief.ends
        row, column = np.indices(FRAME_PX, float)
        self.rays = self.rays_at(row, column)
        angles = np.arange(8) * np.pi / 4
        self.around = [self.rays_at(row + AT_EDGE_PX * np.sin(angle), column + AT_EDGE_PX * np.cos(angle))
                       for angle in angles]
        self.known = self.lands(row, column) & np.all(np.isfinite([self.rays, *self.around]), axis=(0, 3))

    def scene(self):
        """An empty scene with the bench's camera."""
        scene = truth_scenes.empty_scene()
        scene.unit_settings.scale_length = UNIT_M
        scene.render.resolution_y, scene.render.resolution_x = FRAME_PX
        scene.cycles.samples = 4
        camera = scene.camera
        camera.data.clip_start, camera.data.clip_end = 0.1, 1e6
        camera.data.shift_x, camera.data.shift_y = SHIFT
        camera.location, camera.rotation_euler = PLACE, TURN
        return scene

    def rays_at(self, row, column):
        """Unit vectors of the chief rays at places in the frame."""
        tangent = self._chief.matching(np.stack(self.frame.position_mm(row, column), axis=-1), 0)
        ray = np.concatenate([tangent, -np.ones_like(tangent[..., :1])], axis=-1)
        return ray / np.linalg.norm(ray, axis=-1, keepdims=True)

    def places_px(self, points):
        """Rows and columns in the frame of points in the camera's axes: arrays."""
        image_mm = self._chief.matching(points[..., :2] / -points[..., 2:], 1)
        return self.frame.index_of(image_mm[..., 0], image_mm[..., 1])

    def lands(self, row, column):
        """Whether the lens data cover places in the frame."""
        return field_map(self.lens).at_wavelength(reference_nm(self.lens)).within(*self.frame.position_mm(row, column))

    def render(self, scene, products):
        """The channels of the ground truth of a scene."""
        with tempfile.TemporaryDirectory() as folder:
            result = addon.render_through_lens(
                scene, frame=1, lens=self.name, lens_quality="preview", focus=np.inf, depth="off", truth=products,
                wavelengths_nm=(reference_nm(self.lens),), output_folder=Path(folder), files="pictures")
            (_, channels), = read_parts(result.truth)
        return {name.partition(".")[2]: plane for name, plane in channels.items()}


    def pixel_m(self, distance_m):
        """Width of a pixel on the axis at a distance, along the picture's height."""
        return distance_m * self.frame.pitch_um * 1e-3 / self.lens.capture_focal_length_mm


@dataclass(frozen=True, eq=False)
class Hits:
    """What rays meet, in the camera's axes and in metres: arrays (row, column, ...).

    Attributes
    ----------
    what : int array
        A number for each thing, 0 for the background.
    points, normals : arrays (row, column, 3)
    uv : array (row, column, 2) or None
    """

    what: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    uv: np.ndarray | None = None


class Plane:
    """A board of squares, which alternate between two materials.

    Parameters
    ----------
    middle_m : (float, float, float)
        In the camera's axes.
    turn : Euler
        From the axes of the camera to the axes of the board: x along its width, y along its height, z its normal.
    size_m : (float, float)
    """

    squares = 16, 12
    object_index, material_indices = 32767, (3, 2049)

    def __init__(self, middle_m, turn, size_m):
        self.middle_m, self.size_m = np.array(middle_m), np.array(size_m)
        self.axes = np.array(turn.to_matrix())

    def add(self, scene):
        """Add the board, in Blender units."""
        across, down = (np.linspace(-0.5, 0.5, n + 1) for n in self.squares)
        corners = np.array([(x, y) for y in down for x in across])
        first = np.array([row * across.size + column for row in range(down.size - 1)
                          for column in range(across.size - 1)])
        faces = first[:, None] + (0, 1, across.size + 1, across.size)
        mesh = bpy.data.meshes.new("Board")
        mesh.from_pydata(np.pad(corners * self.size_m, ((0, 0), (0, 1))) / UNIT_M, [], faces.tolist())
        uv = mesh.uv_layers.new().uv
        for loop in mesh.loops:
            uv[loop.index].vector = corners[loop.vertex_index] + 0.5
        for index in self.material_indices:
            mesh.materials.append(truth_scenes.glow(f"Squares {index}"))
            mesh.materials[-1].pass_index = index
        for number, face in enumerate(mesh.polygons):
            face.material_index = sum(divmod(number, self.squares[0])) % 2
        return place(scene, "Board", mesh, self.middle_m, self.axes, self.object_index)

    def met(self, rays):
        distance_m = (self.middle_m @ self.axes[:, 2]) / (rays @ self.axes[:, 2])
        points = distance_m[..., None] * rays
        uv = (points - self.middle_m) @ self.axes[:, :2] / self.size_m + 0.5
        on = (distance_m > 0) & np.all((uv >= 0) & (uv < 1), axis=-1)
        square = np.floor(np.where(on[..., None], uv, 0) * self.squares).astype(int)
        what = np.where(on, 1 + square.sum(axis=-1) % 2, 0)
        return Hits(what, points, np.broadcast_to(self.axes[:, 2], points.shape), uv)


def place(scene, name, mesh, middle_m, axes, index):
    """Add an object at a place in the camera's axes."""
    new = bpy.data.objects.new(name, mesh)
    new.pass_index = index
    scene.collection.objects.link(new)
    local = Matrix(np.block([[axes, np.array(middle_m)[:, None] / UNIT_M], [np.zeros(3), 1]]).tolist())
    new.matrix_world = Matrix.LocRotScale(PLACE, TURN, None) @ local
    return new


class Balls:
    """Balls in the camera's axes, in metres: centres (ball, 3) and radii (ball,)."""

    def __init__(self, centres_m, radii_m):
        self.centres_m, self.radii_m = np.array(centres_m), np.array(radii_m)

    def add(self, scene):
        """Add them as instances of one mesh; returns the objects."""
        bpy.ops.mesh.primitive_uv_sphere_add(segments=256, ring_count=128, radius=1)
        pattern = bpy.context.object
        mesh = pattern.data
        mesh.shade_smooth()
        bpy.data.objects.remove(pattern)
        mesh.materials.append(truth_scenes.glow("Ball"))
        return [place(scene, f"Ball {number}", mesh, centre_m, radius_m / UNIT_M * np.eye(3), number)
                for number, (centre_m, radius_m) in enumerate(zip(self.centres_m, self.radii_m, strict=True), 1)]

    def only(self, number):
        """The ball with this number, from 1, alone."""
        return Balls(self.centres_m[number - 1:number], self.radii_m[number - 1:number])

    def met(self, rays):
        along = rays @ self.centres_m.T
        root = along**2 - np.sum(self.centres_m**2, axis=1) + self.radii_m**2
        distance_m = np.where((root > 0) & (along > 0), along - np.sqrt(np.maximum(root, 0)), np.inf)
        nearest = np.argmin(distance_m, axis=-1)
        least_m = np.take_along_axis(distance_m, nearest[..., None], -1)[..., 0]
        points = np.where(np.isfinite(least_m), least_m, 0)[..., None] * rays
        normals = (points - self.centres_m[nearest]) / self.radii_m[nearest][..., None]
        return Hits(np.where(np.isfinite(least_m), nearest + 1, 0), points, normals)


def vectors(channels, name, axes="XYZ"):
    return np.stack([channels[f"{name}.{axis}"] for axis in axes], axis=-1).astype(float)


class Comparison:
    """The channels of a render next to the geometry of its scene, at pixels that the lens data cover.

    Errors are the largest away from edges, or the largest in a `share` of these pixels.
    """

    def __init__(self, bench, channels, met, share=1.0):
        self.bench, self.channels, self.hits, self.share = bench, channels, met(bench.rays), share
        self._even = bench.known.copy()
        for rays in bench.around:
            self._even &= met(rays).what == self.hits.what
        self.inside = self._even & (self.hits.what > 0)

    def ids(self, shown, expected):
        """Share of pixels with another id than in their middle, and of those away from edges."""
        wrong = (shown != expected) & self.bench.known
        return wrong.mean(), (wrong & self._even).mean()

    def depth(self):
        """Largest relative errors along the axis, along the ray, and of the background's pixels."""
        points = self.hits.points
        pairs = (-points[..., 2], "Depth.Z"), (np.linalg.norm(points, axis=-1), "Distance.Z")
        errors = [self.worst(self.channels[name] / true - 1) for true, name in pairs]
        empty = self._even & (self.hits.what == 0)
        return *errors, bool(np.all(self.channels["Depth.Z"][empty] == np.float32(1e10)))

    def position_px(self):
        """Largest distance of positions, in pixels at their distance."""
        rotation, camera_m = np.array(TURN.to_matrix()), np.array(PLACE) * UNIT_M
        true = self.hits.points @ rotation.T + camera_m
        missed_m = np.linalg.norm(vectors(self.channels, "Position") - true, axis=-1)
        return self.worst(missed_m / self.bench.pixel_m(np.linalg.norm(self.hits.points, axis=-1)))

    def normal_deg(self):
        """Largest angle between normals."""
        true = self.hits.normals @ np.array(TURN.to_matrix()).T
        cross = np.linalg.norm(np.cross(vectors(self.channels, "Normal"), true), axis=-1)
        return self.worst(np.degrees(np.arcsin(np.minimum(cross, 1))))

    def uv_px(self, size_m):
        """Largest error of UV on a board, in pixels at its distance."""
        missed_m = np.linalg.norm((vectors(self.channels, "UV", "UV") - self.hits.uv) * size_m, axis=-1)
        return self.worst(missed_m / self.bench.pixel_m(np.linalg.norm(self.hits.points, axis=-1)))

    def worst(self, errors):
        return float(np.quantile(np.abs(errors[self.inside]), self.share))


def board_figures(bench):
    board = Plane((0.1, 0.05, -3.0), Euler((0.5, -0.4, 0.2)), (4.4, 3.0))
    scene = bench.scene()
    board.add(scene)
    compared = Comparison(bench, bench.render(scene, "depth,position,normal,uv,index"), board.met)
    along_axis, along_ray, empty = compared.depth()
    index, of_material = (compared.channels[f"{name} Index.X"] for name in ("Object", "Material"))
    yield "board: depth along the axis, relative", along_axis, 1e-3
    yield "board: distance along the ray, relative", along_ray, 1e-3
    yield "board: position, in pixels", compared.position_px(), 0.1
    yield "board: normal, in degrees", compared.normal_deg(), 0.01
    yield "board: UV, in pixels", compared.uv_px(board.size_m), 0.1
    wrong, away = compared.ids(index, np.where(compared.hits.what, board.object_index, 0))
    yield "board: pixels with another object's index", wrong, 0.01
    yield "the same, away from edges", away, 0.0
    wrong, away = compared.ids(of_material, np.choose(compared.hits.what, (0, *board.material_indices)))
    yield "board: pixels with another material's index", wrong, 0.1
    yield "the same, away from edges", away + (not empty), 0.0


def floor_figures(bench):
    floor = Plane((0.0, -1.2, -250.0), Euler((-np.pi / 2, 0, 0)), (900.0, 499.0))
    scene = bench.scene()
    floor.add(scene)
    compared = Comparison(bench, bench.render(scene, "depth"), lambda rays: replace(
        hits := floor.met(rays), what=np.minimum(hits.what, 1)))
    along_axis, along_ray, _ = compared.depth()
    far_m = -compared.hits.points[compared.inside, 2]
    print(f"floor from {far_m.min():.1f} to {far_m.max():.0f} m")
    yield "floor: depth along the axis, relative", along_axis, 0.002
    yield "floor: distance along the ray, relative", along_ray, 0.002


def ball_figures(bench):
    ball, wall = Balls([(0.2, 0.1, -2.5)], [0.35]), Plane((0.0, 0.0, -6.0), Euler((0.0, 0.3, 0.0)), (16.0, 12.0))
    step_m, camera_step_m = np.array((0.11, -0.07, 0.25)), np.array((-0.04, 0.06, 0.1))
    scene = bench.scene()
    wall.add(scene)
    moved = ball.add(scene)[0]
    rotation = np.array(TURN.to_matrix())
    for obj, step in ((moved, step_m), (scene.camera, camera_step_m)):
        begin = np.array(obj.location)
        for frame in (0, 1, 2):
            obj.location = begin + rotation @ step / UNIT_M * (frame - 1)
            obj.keyframe_insert("location", frame=frame)
    compared = Comparison(bench, bench.render(scene, "flow"), nearer(ball, wall))
    for sign in (-1, 1):
        step = sign * (np.where((compared.hits.what == 1)[..., None], step_m, 0) - camera_step_m)
        missed_px = missed_flow_px(bench, compared.channels, sign, compared.hits.points + step)
        for what, name in ((1, "ball"), (2, "wall")):
            yield (f"{name}: flow {WHEN[sign]}, in pixels",
                   float(np.nanmax(missed_px[compared.inside & (compared.hits.what == what)])), 0.1)


def sky_figures(bench):
    """The background of a camera that turns and moves."""
    scene = bench.scene()
    truth_scenes.set_even_light(scene, 1.0)
    turns = [Euler(np.add(TURN, np.multiply(SKY_TURN, sign))) for sign in (-1, 0, 1)]
    for frame, turn in enumerate(turns):
        scene.camera.rotation_euler, scene.camera.location.x = turn, PLACE.x + 20 * (frame - 1)
        for path in ("rotation_euler", "location"):
            scene.camera.keyframe_insert(path, frame=frame)
    channels, axes = bench.render(scene, "flow"), [np.array(turn.to_matrix()) for turn in turns]
    for sign in (-1, 1):
        missed_px = missed_flow_px(bench, channels, sign, bench.rays @ axes[1].T @ axes[1 + sign])
        yield f"background: flow {WHEN[sign]}, in pixels", float(np.nanmax(missed_px[bench.known])), 0.1


def missed_flow_px(bench, channels, sign, points):
    """Distances between the flow and the ways to or from these points of the camera's axes then, in pixels: NaN for
    points beyond the lens data. `sign` is -1 for the frame before, and 1 for the next one."""
    (rows, columns), (row, column) = np.indices(FRAME_PX), bench.places_px(points)
    right, up = np.moveaxis(-sign * vectors(channels, "Vector", "XY" if sign < 0 else "ZW"), -1, 0)
    lands = bench.lands(row, column)
    print(f"longest flow {np.hypot(column - columns, row - rows)[bench.known & lands].max():.1f} px")
    return np.where(lands, np.hypot(right - (column - columns), up - (rows - row)), np.nan)


def nearer(ball, wall):
    """What rays meet first: 1 for a ball, 2 for a wall."""
    def met(rays):
        of_ball, of_wall = ball.met(rays), wall.met(rays)
        on = of_ball.what > 0
        return Hits(np.where(on, 1, np.where(of_wall.what > 0, 2, 0)),
                    np.where(on[..., None], of_ball.points, of_wall.points),
                    np.where(on[..., None], of_ball.normals, of_wall.normals))
    return met


def instance_figures(bench):
    random = np.random.default_rng(SEED)
    distance_m = random.uniform(2, 12, BALLS)
    centres_m = distance_m[:, None] * bench.rays_at(*(random.uniform(0, n, BALLS) for n in FRAME_PX))
    balls = Balls(centres_m, 0.06 * distance_m * bench.lens.sensor_mm[1] / bench.lens.capture_focal_length_mm)
    scene = bench.scene()
    objects = balls.add(scene)
    compared = Comparison(bench, bench.render(scene, "depth,normal,index,object,cryptomatte"), balls.met, 0.99)
    names = np.array([0, *(id_of(obj.name) for obj in objects)], np.float32)
    wrong, away = compared.ids(compared.channels["Object Index.X"], compared.hits.what)
    yield "200 balls: pixels with another ball's index", wrong, 0.1
    yield "the same, away from edges", away, 0.0
    yield from box_figures(compared, balls, [obj.name for obj in objects])
    wrong, away = compared.ids(compared.channels["CryptoObject00.r"], names[compared.hits.what])
    yield "200 balls: pixels with another ball first in Cryptomatte", wrong, 0.1
    yield "the same, away from edges", away, 1e-3
    along_axis, *_ = compared.depth()
    yield "200 balls: depth along the axis, relative, in 99 % of the pixels", along_axis, 0.01
    yield "200 balls: normal, in degrees, in 99 % of the pixels", compared.normal_deg(), 10.0


def box_figures(compared, balls, names):
    """Boxes of annotations, compared with boxes around the pixels whose chief rays meet each ball."""
    numbers = {name: number for number, name in enumerate(names, 1)}
    objects = {name: ShownObject(number, 1) for name, number in numbers.items()}
    shown = {each["category_id"]: each["bbox"]
             for each in annotations_of(compared.channels[OBJECT], objects, numbers)}
    known = compared.bench.known
    missed_px, complete = [], []
    for number in range(1, len(names) + 1):
        inside = (compared.hits.what == number) & known
        alone = balls.only(number).met(compared.bench.rays).what > 0
        if inside.any():
            missed_px.append(np.abs(edges(shown[number]) - edges(box_of(inside))).max() if number in shown else np.inf)
            complete.append(np.array_equal(inside, alone) and known[around(box_of(inside))].all())
    print(f"{np.sum(complete)} of {len(complete)} balls in full view")
    yield "200 balls: edges of the boxes of balls in full view, in pixels", max(np.array(missed_px)[complete]), 1.0
    yield "boxes more than a pixel off, of all", np.mean(np.array(missed_px) > 1), 0.1


def box_of(mask):
    """Left, top, width and height of some pixels."""
    rows, columns = np.nonzero(mask)
    return columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1


def around(box):
    """The pixels of a box, and those next to it."""
    left, top, width, height = box
    return slice(max(top - 1, 0), top + height + 1), slice(max(left - 1, 0), left + width + 1)


def edges(box):
    """Left, top, right and lower edge of a box."""
    left, top, width, height = box
    return np.array([left, top, left + width, top + height])


def cost():
    """Processor seconds of the sample scene, its camera moving, without and with all ground truth."""
    bpy.ops.wm.open_mainfile(filepath=str(SAMPLE_SCENE))
    scene = bpy.context.scene
    scene.render.resolution_y, scene.render.resolution_x, scene.render.resolution_percentage = *FRAME_PX, 100
    scene.cycles.samples, scene.cycles.device = COST_SAMPLES, "CPU"
    for frame in (0, 2):
        scene.camera.location.x += 0.01
        scene.camera.keyframe_insert("location", frame=frame)

    def seconds(products):
        with tempfile.TemporaryDirectory() as folder:
            begin = time.process_time()
            addon.render_through_lens(scene, frame=1, lens="tessar-50mm", lens_quality="preview", truth=products,
                                      output_folder=Path(folder))
            return time.process_time() - begin

    seconds("")  # fills the caches
    without, with_all = np.median([(seconds(""), seconds(",".join(OF_CHIEF_RAYS))) for _ in range(COST_RUNS)], axis=0)
    return (f"The sample scene, {FRAME_PX[1]} × {FRAME_PX[0]} px, {COST_SAMPLES} samples, takes {without:.1f} "
            f"processor seconds without ground truth, and {with_all:.1f} with all of it (medians of {COST_RUNS}).")


def figures(name):
    """(text, value, limit) of all figures of a lens."""
    bench = Bench(name)
    for scene in (board_figures, floor_figures, ball_figures, sky_figures, instance_figures):
        for figure in scene(bench):
            print(f"{name}: {figure[0]}: {figure[1]:.2g} (limit {figure[2]:g})", flush=True)
            yield figure


def table_of(table):
    """A table of the figures of lenses, by name."""
    rows = [["", "limit", *(f"{name} ({kind})" for name, kind in LENSES.items())]]
    for same in zip(*table.values(), strict=True):
        text, _, limit = same[0]
        rows.append([text, f"{limit:g}", *(f"{value:.2g}" if value <= limit else f"**{value:.2g}**"
                                           for _, value, _ in same)])
    head, *body = rows
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *body))


def compare(figures_of, cost_line, place_of_table, arguments):
    """Print the figures of all lenses and the cost, write them to the page in the arguments, if any, and exit."""
    addon.register()
    table = {name: list(figures_of(name)) for name in LENSES}
    text = f"{table_of(table)}\n\n{cost_line()}"
    print(text)
    if arguments:
        page = Path(arguments[0])
        page.write_text(place_of_table.sub(lambda _: text, page.read_text(encoding="utf-8")), encoding="utf-8")
    sys.stdout.flush()
    status = int(any(value > limit for same in table.values() for _, value, limit in same))
    os._exit(status)  # some of Blender's wheels crash while the interpreter exits


if __name__ == "__main__":
    compare(figures, cost, TABLE, sys.argv[1:])
