"""The scene of the lenses' pictures: a small bust under a gate of bulbs, in a city at night with lamps at many depths.

The scene is a function of the direction from the axis, so that it can be captured in the projection of any lens.
Positions u (to the right) and v (upwards) are in heights of the frame, and depths in distances of the bust: for a
longer lens, which is farther away, the same picture is of a deeper scene.
"""

from itertools import pairwise
from pathlib import Path

import bpy
import numpy as np
import scipy

from lensfield.engine.image.layers import Layer
from lensfield.engine.pictures.spectral_exr import read_parts
from lensfield.engine.spectral.colour import light_basis

BUST_SCENE = Path(__file__).resolve().parents[2] / "sample_scenes" / "night_portrait.blend"
BUST = "Head", "Hair", "Cloche", "Band", "Lash", "Brow", "Earrings", "Brooch beads", "Scarf", "Coat"
BUST_PX, BUST_SAMPLES, BUST_VIEW_DEG = 320, 64, 15
BUST_HEIGHT, BUST_V = 1.06, -0.06  # of its square picture

PARTS = 2  # of a pixel, down and across
WIDEST_DEG = 89
GATE_U, GATE_V, BAR = 0.73, 0.41, 0.008  # half its width, its top, and half the width of its bars
BULB_STEP, BULB_RADIUS, BULB_LIGHT = 0.0912, 0.0035, 9.0
GATE_RGB, BULB_RGB = (0.10, 0.08, 0.07), (1.0, 0.62, 0.28)

GROUND_V, TILE, JOINT = -1.0, 0.5, 0.04
STONE_RGB, JOINT_RGB = (0.070, 0.056, 0.052), (0.008, 0.008, 0.010)
CITY, SKY = 25.0, 100.0  # depths
HOUSE, ROOFS, WINDOW, PANE = 2.4, (2.5, 9.0), (0.6, 0.9), 0.28  # widths, heights; half a pane as a part of its window
HOUSES, WINDOWS = 97, 64  # after which they repeat
LIT_SHARE, LIT_RGB, UNLIT_RGB, WALL_RGB = 0.3, (0.8, 0.5, 0.2), (0.010, 0.012, 0.02), (0.02, 0.016, 0.02)
DUSK_RGB, NIGHT_RGB = (0.10, 0.045, 0.03), (0.022, 0.052, 0.14)

SLABS = 1.0, 3.0, 8.0, np.inf  # depths that divide the lamps into layers
LAMP_DEPTHS = 2.5, 4.0, 7.0, 12.0, 20.0
LAMP_RGB = (*[(1.0, 0.48, 0.14)] * 5, *[(1.0, 0.62, 0.3)] * 4, *[(1.0, 0.8, 0.6)] * 2, *[(0.25, 0.55, 1.0)] * 2,
            (1.0, 0.08, 0.05), (0.12, 1.0, 0.4))
LAMPS, CANDIDATES, LAMP_RADIUS, LAMP_LIGHT = 360, 12, 0.004, 85.0
REACH, WIDEST_LAMP_RAD = 1.3, 1.5  # positions r are even over atan(r / REACH), up to this angle


def render_bust(folder):
    """The bust in front of nothing: array (row, column, 4), premultiplied by its alpha."""
    bpy.ops.wm.open_mainfile(filepath=str(BUST_SCENE))
    scene = bpy.context.scene
    for thing in scene.objects:
        is_lamp = thing.type == "LIGHT" and thing.data.type == "AREA"
        thing.hide_render = not is_lamp and thing.name.split(".")[0] not in BUST
    camera, render = scene.camera.data, scene.render
    camera.sensor_fit, camera.angle = "HORIZONTAL", np.radians(BUST_VIEW_DEG)
    camera.dof.use_dof = False
    render.resolution_x = render.resolution_y = BUST_PX
    render.film_transparent, scene.cycles.samples = True, BUST_SAMPLES
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    render.filepath = str(Path(folder) / "bust.exr")
    bpy.ops.render.render(write_still=True)
    _, planes = read_parts(render.filepath)[0]
    return np.stack([planes[channel] for channel in "RGBA"], axis=-1)


def scene_layers(bust, grid, focal_mm, wavelengths_nm):
    """The scene in the grid of a capture: layers from near to far, with depths in distances of the bust.

    In a plane, the layers do not depend on the focal length.
    """
    u, v, captured = _directions(grid, focal_mm)
    lamps = _lamps()
    *near, (rgb, alpha, depth) = (_lit(lamps[(first <= lamps[:, 2]) & (lamps[:, 2] < last)], u, v)
                                  for first, last in pairwise(SLABS))
    city, city_depth = _city(u, v)
    far = _chosen(alpha > 0, rgb, city), np.ones_like(alpha), np.where(alpha > 0, depth, city_depth)
    basis = light_basis(wavelengths_nm)
    return [_layer(rgb * captured[..., None], alpha, depth, basis)
            for rgb, alpha, depth in (_front(bust, u, v), *near, far)]


def _directions(grid, focal_mm):
    """u and v of each part of a pixel, and whether it shows an angle below WIDEST_DEG."""
    x_mm, y_mm = np.meshgrid(*grid.finer(PARTS).axes_mm())
    x_mm *= grid.squeeze
    radius = np.hypot(x_mm, y_mm) / focal_mm
    angle = grid.projection.angle_rad(radius)
    height_mm = grid.frame_px[0] * grid.pitch_um * 1e-3
    stretch = np.tan(np.minimum(angle, np.radians(WIDEST_DEG))) / np.maximum(radius, 1e-9) / height_mm
    return x_mm * stretch, y_mm * stretch, angle < np.radians(WIDEST_DEG)


def _layer(rgb, alpha, depth, basis):
    """A layer from a picture whose pixels have PARTS x PARTS parts."""
    light = np.einsum("yxc,nc->nyx", _merged(rgb * alpha[..., None]), basis)
    cover = _merged(alpha)
    nearness = _merged(alpha / depth) / np.maximum(cover, 1e-9)
    return Layer(np.maximum(light, 0), cover, np.divide(1, nearness, out=np.ones_like(cover), where=cover > 0))


def _merged(fine):
    rows, columns, *rest = fine.shape
    return fine.reshape(rows // PARTS, PARTS, columns // PARTS, PARTS, *rest).mean(axis=(1, 3))


def _front(bust, u, v):
    """The bust, and the gate around it: light, alpha and depth."""
    row, column = (0.5 - (v - BUST_V) / BUST_HEIGHT) * BUST_PX - 0.5, (0.5 + u / BUST_HEIGHT) * BUST_PX - 0.5
    *rgb, alpha = (scipy.ndimage.map_coordinates(plane, (row, column), order=1) for plane in np.moveaxis(bust, -1, 0))
    covered = alpha[..., None] > 0
    rgb = np.divide(np.stack(rgb, -1), alpha[..., None], out=np.zeros((*u.shape, 3)), where=covered)
    gate, is_gate = _gate(u, v)
    is_gate &= alpha == 0
    return _chosen(is_gate, gate, rgb), np.where(is_gate, 1, alpha), np.ones_like(u)


def _gate(u, v):
    """The light of two posts and a beam with small bulbs, and where they are."""
    from_post, from_beam = np.abs(np.abs(u) - GATE_U), np.abs(v - GATE_V)
    is_post, is_beam = (from_post < BAR) & (v < GATE_V + BAR), (from_beam < BAR) & (np.abs(u) < GATE_U)
    along, across = np.where(is_post, v - GATE_V, u), np.where(is_post, from_post, from_beam)
    is_bulb = np.hypot(along - BULB_STEP * np.round(along / BULB_STEP), across) < BULB_RADIUS
    return _chosen(is_bulb, np.multiply(BULB_RGB, BULB_LIGHT), GATE_RGB), is_post | is_beam


def _city(u, v):
    """The light of ground, houses and sky, and their depth."""
    ground_depth = GROUND_V / np.minimum(v, -1e-6)
    house, is_house = _houses(u * CITY, v * CITY)
    is_ground = ground_depth < CITY
    return (_chosen(is_ground, _ground(u * ground_depth, ground_depth), _chosen(is_house, house, _sky(u, v))),
            np.where(is_ground, ground_depth, np.where(is_house, CITY, SKY)))


def _ground(x, depth):
    """Square stones with dark joints."""
    from_joint = np.minimum(np.abs((x / TILE + 0.5) % 1 - 0.5), np.abs(depth / TILE % 1 - 0.5))
    return _chosen(from_joint < JOINT, JOINT_RGB, STONE_RGB)


def _houses(x, y):
    """The light of houses with lit windows, and where they are."""
    random = np.random.default_rng(3)
    roof = random.uniform(*ROOFS, HOUSES)[np.floor(x / HOUSE).astype(int) % HOUSES]
    is_lit = random.random((WINDOWS, WINDOWS)) < LIT_SHARE
    column, floor = x / WINDOW[0], y / WINDOW[1]
    is_lit = is_lit[np.floor(column).astype(int) % WINDOWS, np.floor(floor).astype(int) % WINDOWS]
    is_window = np.maximum(np.abs(column % 1 - 0.5), np.abs(floor % 1 - 0.5)) < PANE
    return _chosen(is_window, _chosen(is_lit, LIT_RGB, UNLIT_RGB), WALL_RGB), y < roof


def _sky(u, v):
    """Dusk at the horizon, night above."""
    height = np.clip(v / np.hypot(u, 1), 0, 1)[..., None]
    return np.multiply(DUSK_RGB, (1 - height) ** 4) + NIGHT_RGB


def _chosen(condition, colour, other):
    return np.where(condition[..., None], colour, other)


def _lamps():
    """Lamps, evenly scattered: rows of u, v, depth, radius, red, green and blue.

    Each is the one of some candidates that is farthest from the previous lamps.
    """
    random = np.random.default_rng(11)
    angles = np.zeros((0, 2))
    for _ in range(LAMPS):
        new = random.uniform(-WIDEST_LAMP_RAD, WIDEST_LAMP_RAD, (CANDIDATES, 2))
        new = new[np.hypot(*new.T) < WIDEST_LAMP_RAD]
        distances = np.hypot(*(new[:, None] - angles).T)
        angles = np.append(angles, new[[np.argmax(np.min(distances, axis=0, initial=np.inf))]], axis=0)
    angle = np.hypot(*angles.T)
    u, v = angles.T * REACH * np.tan(angle) / angle
    depth = random.permutation(np.resize(LAMP_DEPTHS, LAMPS))
    depth = np.minimum(depth, np.maximum(GROUND_V / np.minimum(v, -1e-6), SLABS[0]))  # not below the ground
    radius = LAMP_RADIUS * random.uniform(0.75, 1.25, LAMPS) / np.cos(angle) ** 2
    return np.column_stack([u, v, depth, radius, random.permutation(np.resize(LAMP_RGB, (LAMPS, 3)))])


def _lit(lamps, u, v):
    """The light, alpha and depth of lamps."""
    rgb, alpha, depth = np.zeros((*u.shape, 3)), np.zeros(u.shape), np.ones(u.shape)
    for lamp_u, lamp_v, lamp_depth, radius, *colour in lamps:
        rows, columns = np.nonzero((np.abs(u - lamp_u) < radius) & (np.abs(v - lamp_v) < radius))
        inside = np.hypot(u[rows, columns] - lamp_u, v[rows, columns] - lamp_v) < radius
        place = rows[inside], columns[inside]
        rgb[place], alpha[place], depth[place] = np.multiply(LAMP_LIGHT, colour), 1, lamp_depth
    return rgb, alpha, depth
