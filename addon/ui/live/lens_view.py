"""Draws the camera's view of a 3D viewport through a lens, from the viewport's own light and depth.

The viewport's picture is read when Blender has drawn the scene and its overlays, which stay undistorted on top. Each
pixel of the lens's frame then gathers the light of a few rays: by the lens's tables, where the rays come from; by the
viewport's depth, how far out of focus things are. Light from outside the viewport and from hidden surfaces is unknown.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files

import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from lensfield.engine.look.lens_tables import BOKEH_NODES, NODES, RAYS, STEEPEST_RAD, LensTables
from lensfield.engine.rays.stop_places import cell_size, stop_places

SOURCES = files(__package__) / "shaders"
TILE_PX, REACH_TILES = 16, 6  # blur reaches at most their product from its middle
SHARP_PX, BLURRED_PX = 0.8, 2.0  # diameters of blur that is not drawn, and that is drawn alone
FEW_RAYS_PX = 6.0  # a quarter of the rays suffices for smaller blur
METERED_STEP = 3  # between metered nodes of the tables
AS_IT_IS = 0.0  # exposure of light that no camera takes
FARTHEST_DEPTH = 1.0  # normalised, also of viewports without depth
PITCH_PX = {2: 2, 4: 2, 8: 2, 16: 4}
"""Copies of the light for rays at a distance: the width that light is spread over, and the side of their pixels. Fine
pixels and a gradual spread keep the rays' discs from showing squares, and their lattice."""
SPREAD = 0.2  # of the light of a ray, in diameters of the blur: twice its standard deviation, where it is largest
VARIANCES = {1: 1 / 6, 2: 2 / 3, 4: 2 / 3 + 2, 8: 2 / 3 + 10, 16: 8 / 3 + 42}
"""Of light around a ray in these copies, and in the light itself: down or across, in square pixels. A pixel, and the
place in it that is looked up, have a twelfth of its squared side each; each `smooth`, half the square of its reach."""
PATTERN = 5  # texels of the mean and the covariance of a place's rays
BETWEEN = "halved"  # a step of the last copy
HALVES = "nearer", "farther", "blurs"
FINER_HALVES = tuple(f"finer_{name}" for name in HALVES)
SHARPER_HALVES = tuple(f"sharper_{name}" for name in HALVES)
WITH_HALVES = "split", "halve", "smooth"  # shaders
MOST_SIZES = 2  # viewports of different sizes that are drawn in turn
CONSTANTS = {"TILE": TILE_PX, "REACH": REACH_TILES, "SHARP_PX": SHARP_PX, "BLURRED_PX": BLURRED_PX,
             "CELL": cell_size(RAYS) / 2, "CELLS": float(0.5 / (stop_places(RAYS)**2).sum(axis=0).mean()),
             "STEEPEST": STEEPEST_RAD, "FARTHEST": 1e30, "SPREAD": SPREAD, "FEW_RAYS_PX": FEW_RAYS_PX, "FEWER": 4,
             "NODES": NODES, "BOKEH_NODES": BOKEH_NODES, "RAYS": RAYS, "PATTERNS": 2 * BOKEH_NODES * RAYS,
             "PATTERN": PATTERN} | {f"VARIANCE_{width}": variance for width, variance in VARIANCES.items()}
"""CELLS is the variance of the stop over that of its rays, which lack the spread of their cells."""

SAMPLERS = {"blur": ("colours", "depths"), "split": ("light",), "halve": FINER_HALVES, "smooth": SHARPER_HALVES,
            "tiles": ("light",), "reach": ("tiles",),
            "lens": ("colours", "tables", "light", "reaches",
                     *(f"{name}_{width}" for width in PITCH_PX for name in HALVES))}
VALUES = {"blur": {"focus": "VEC4", "lean": "VEC2", "most_px": "FLOAT"}, "reach": {"widest": "FLOAT"},
          "smooth": {"reach": "FLOAT"},
          "lens": {"frame": "VEC4", "view": "VEC4", "has_depth": "FLOAT", "shows_through": "FLOAT",
                   "exposure": "FLOAT"}}
"""The textures and the values of each shader."""


@dataclass(frozen=True)
class View:
    """What a viewport shows of a camera's view.

    Attributes
    ----------
    middle_px : (float, float)
        Of the optical axis in the region, to the right and up.
    px_per_tangent : (float, float)
        Pixels for the tangent of an angle from the axis, to the right and up.
    nearness_per_depth, depth_at_infinity : float
        The inverse of a distance along the axis, per scene unit, is the first times the sum of a normalised depth and
        the second.
    """

    middle_px: tuple[float, float]
    px_per_tangent: tuple[float, float]
    nearness_per_depth: float
    depth_at_infinity: float

    @classmethod
    def of(cls, window_matrix, width_px: int, height_px: int) -> "View":
        """The view of a region with this perspective projection."""
        matrix = window_matrix
        return cls(((1 - matrix[0][2]) * width_px / 2, (1 - matrix[1][2]) * height_px / 2),
                   (matrix[0][0] * width_px / 2, matrix[1][1] * height_px / 2), 1 / matrix[2][3], matrix[2][2])


@dataclass(frozen=True)
class Defocus:
    """Blur by depth in a viewport.

    Attributes
    ----------
    px_m : float
        Diameter of the blur of infinitely distant points, times the focus distance: in pixels times metres.
    nearness_per_m : float
        The inverse of the focus distance, on the axis.
    lean_per_m : (float, float)
        Its rise with the tangents to the right and up.
    metres_per_unit : float
        Of the scene.
    """

    px_m: float
    nearness_per_m: float
    lean_per_m: tuple[float, float]
    metres_per_unit: float


class Tables:
    """The tables of a lens on the graphics processor, in one texture: some processors accept only 16 in a shader.

    Parameters
    ----------
    tables : LensTables
    """

    def __init__(self, tables: LensTables) -> None:
        red, green, blue = np.moveaxis(tables.angle_rad, 2, 0)
        light = np.stack([tables.illumination, np.zeros_like(tables.illumination)], axis=-1)
        radius = np.broadcast_to(tables.stop_radius, tables.light.shape)
        rays = np.stack([np.concatenate([tables.shifts, tables.aberrations], axis=-1),
                         np.stack([tables.light, radius, *np.zeros((2, *radius.shape))], axis=-1)], axis=-2)
        of_nodes = np.concatenate([rays.reshape(BOKEH_NODES, -1, 4),
                                   _patterns(rays[..., 0, :], tables.light).reshape(BOKEH_NODES, -1, 4)], axis=1)
        values = np.zeros((BOKEH_NODES + NODES, max(2 * NODES, of_nodes.shape[1]), 4))
        values[:BOKEH_NODES, :of_nodes.shape[1]] = of_nodes
        values[BOKEH_NODES:, :NODES] = np.concatenate([red, green], axis=-1)
        values[BOKEH_NODES:, NODES:2 * NODES] = np.concatenate([blue, light], axis=-1)
        self.texture = _texture(values)
        some = slice(None, None, METERED_STEP)
        self._green, self._illumination = _tangents(tables.angle_rad[some, some, 1]), tables.illumination[some, some]
        self._widths = np.linalg.norm(tables.shifts, axis=-1).max(axis=2, initial=1, where=tables.light > 0)

    def widest(self, view: "View", width: int, height: int) -> float:
        """Largest shift of the rays that a viewport of this size may show: those at a fisheye's edge come from beyond
        it, and are the wider the closer they are to 90 degrees from the axis."""
        *_, seen = self._seen(view, width, height)
        row, column = (np.rint(index * (BOKEH_NODES - 1) / (len(seen) - 1)).astype(int) for index in np.nonzero(seen))
        return float(self._widths[row, column].max(initial=1))

    def metered(self, light: np.ndarray, view: "View") -> np.ndarray:
        """The picture at places that are even over the frame, without blur: array (place, 3).

        Parameters
        ----------
        light : array (row, column, 4)
            Of the viewport, bottom row first.
        view : View
        """
        rows, columns, _ = light.shape
        row, column, seen = self._seen(view, columns, rows)
        return light[row[seen], column[seen], :3] * self._illumination[seen, None]

    def _seen(self, view, width, height):
        """Rows and columns in a viewport of the metered nodes, and whether they are inside."""
        column, row = np.moveaxis(np.floor(self._green * view.px_per_tangent + view.middle_px).astype(int), -1, 0)
        return row, column, (row >= 0) & (row < height) & (column >= 0) & (column < width)


def _tangents(angle_rad):
    """Vectors from the axis as long as the tangents of these angles, array (..., 2)."""
    away_rad = np.linalg.norm(angle_rad, axis=-1, keepdims=True)
    longer = np.tan(np.minimum(away_rad, STEEPEST_RAD)) / np.maximum(away_rad, np.finfo(np.float32).tiny)
    return angle_rad * np.where(away_rad > 0, longer, 1)


def draw(framebuffer, tables: Tables, view: View, frame_px, defocus: Defocus, *, transparent: bool,
         exposure_of: Callable[[np.ndarray], float] | None = None) -> bool:
    """Replace a frame in a viewport by its view through a lens.

    Parameters
    ----------
    framebuffer : gpu.types.GPUFrameBuffer
        With the viewport's light and depth.
    tables : Tables
    view : View
    frame_px : (float, float, float, float)
        Left, bottom, width and height of the lens's frame in the region.
    defocus : Defocus
    transparent : bool
        Whether the viewport's background shows through.
    exposure_of : function of the `Tables.metered` light, optional
        Returns the factor of the light that a camera saturates at 1; by default, the light is as in the viewport.

    Returns
    -------
    bool
        Whether the viewport has depth: without it, everything is in focus.
    """
    _, _, width, height = framebuffer.viewport_get()
    with framebuffer.bind():
        light = framebuffer.read_color(0, 0, width, height, 4, 0, "FLOAT")
        depth = np.asarray(memoryview(framebuffer.read_depth(0, 0, width, height)), dtype=np.float32)
    colours, steps = gpu.types.GPUTexture((width, height), format="RGBA16F", data=light), _steps(width, height)
    has_depth = bool(depth.min() < FARTHEST_DEPTH)
    exposure = exposure_of(tables.metered(_pixels(light, width, height), view)) if exposure_of else AS_IT_IS
    gpu.state.blend_set("NONE")
    gpu.state.depth_test_set("NONE")
    gpu.state.depth_mask_set(False)
    if has_depth:
        depths = gpu.types.GPUTexture((width, height), format="R32F",
                                      data=gpu.types.Buffer("FLOAT", depth.size, depth.ravel()))
        widest = tables.widest(view, width, height)
        _split_by_depth(steps, {"colours": colours, "depths": depths}, view, defocus, widest)
    with framebuffer.bind():
        left, bottom, across, up = frame_px
        corners = [(2 * x / width - 1, 2 * y / height - 1)
                   for y in (bottom, bottom + up) for x in (left, left + across)]
        inputs = {"colours": colours, "tables": tables.texture}
        inputs |= {name: steps[name][0] for name in ("light", "reaches")}
        for width in PITCH_PX:
            inputs |= {f"{name}_{width}": texture for name, texture in zip(HALVES, steps[width], strict=True)}
        _fill("lens", corners, inputs, frame=frame_px, view=(*view.px_per_tangent, *view.middle_px),
              has_depth=float(has_depth), shows_through=float(transparent), exposure=exposure)
    return has_depth


def _pixels(buffer, width, height):
    return np.asarray(memoryview(buffer)).reshape(height, width, 4)


def _split_by_depth(steps, viewport, view, defocus, widest):
    """Fill the images between the viewport and the lens image: `_steps`."""
    # per scene unit: nearness = (depth + depth_at_infinity) * nearness_per_depth
    lean = np.divide(defocus.lean_per_m, view.px_per_tangent)
    focus = (view.depth_at_infinity, view.nearness_per_depth / defocus.metres_per_unit, defocus.px_m,
             defocus.nearness_per_m - lean @ view.middle_px)
    _run("blur", steps["light"], viewport, focus=focus, lean=lean, most_px=2 * TILE_PX * REACH_TILES / widest)
    light, = steps["light"]
    _run("split", steps[2], {"light": light})
    _run("smooth", steps[4], _named(SHARPER_HALVES, steps[2]), reach=1.0)
    _run("smooth", steps[8], _named(SHARPER_HALVES, steps[4]), reach=2.0)
    _run("halve", steps[BETWEEN], _named(FINER_HALVES, steps[8]))
    _run("smooth", steps[16], _named(SHARPER_HALVES, steps[BETWEEN]), reach=2.0)
    _run("tiles", steps["tiles"], {"light": light})
    _run("reach", steps["reaches"], {"tiles": steps["tiles"][0]}, widest=widest)


def _patterns(bends, light):
    """Means and covariances of rays, (row, column, ray, quantity): array (row, column, PATTERN, quantity)."""
    light = np.where(light.any(axis=2, keepdims=True), light, 1)
    share = light / light.sum(axis=2, keepdims=True)
    means = np.einsum("yxr,yxri->yxi", share, bends, dtype=float)[:, :, None]
    apart = bends - means
    return np.concatenate([means, np.einsum("yxr,yxri,yxrj->yxij", share, apart, apart)], axis=2)


def _named(names, textures):
    return dict(zip(names, textures, strict=True))


def _texture(values):
    """A texture of an array (row, column, 4), bottom row first."""
    height, width, _ = values.shape
    data = np.ascontiguousarray(values, dtype=np.float32).ravel()
    return gpu.types.GPUTexture((width, height), format="RGBA32F", data=gpu.types.Buffer("FLOAT", data.size, data))


@lru_cache(maxsize=MOST_SIZES)
def _steps(width, height):
    """The images between the viewport and the lens image: dict of tuples of gpu.types.GPUTexture.

    The viewport's light with its blur; smaller copies of its light from before and from behind the focus, with their
    blur, by the widths of `PITCH_PX`; and the least and the largest blur in tiles, and of what reaches them.
    """
    halves_px = PITCH_PX | {BETWEEN: PITCH_PX[16]}
    sides_px = {"light": 1, "tiles": TILE_PX, "reaches": TILE_PX} | halves_px
    return {name: tuple(gpu.types.GPUTexture((-(-width // side), -(-height // side)), format="RGBA16F")
                        for _ in range(len(HALVES) if name in halves_px else 1)) for name, side in sides_px.items()}


def _run(name, images, textures, **values):
    """Fill images by a shader."""
    with gpu.types.GPUFrameBuffer(color_slots=images).bind():
        _fill(name, [(-1, -1), (1, -1), (-1, 1), (1, 1)], textures, **values)


def _fill(name, corners, textures, **values):
    shader = _shader(name)
    shader.bind()
    for each, texture in textures.items():
        shader.uniform_sampler(each, texture)
    for each, value in values.items():
        shader.uniform_float(each, value)
    batch_for_shader(shader, "TRI_STRIP", {"corner": corners}).draw(shader)


@cache
def _shader(name):
    info = gpu.types.GPUShaderCreateInfo()
    for constant, value in CONSTANTS.items():
        info.define(constant, repr(value))
    for slot, sampler in enumerate(SAMPLERS[name]):
        info.sampler(slot, "FLOAT_2D", sampler)
    for value, kind in VALUES.get(name, {}).items():
        info.push_constant(kind, value)
    info.vertex_in(0, "VEC2", "corner")
    for slot, result in enumerate(HALVES if name in WITH_HALVES else ("result",)):
        info.fragment_out(slot, "VEC4", result)
    info.vertex_source((SOURCES / "corners.vert.glsl").read_text(encoding="utf-8"))
    info.fragment_source((SOURCES / f"{name}.frag.glsl").read_text(encoding="utf-8"))
    return gpu.shader.create_from_info(info)


def forget():
    """Release all images and shaders."""
    _steps.cache_clear()
    _shader.cache_clear()
