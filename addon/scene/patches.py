"""Patches of lamps, glowing meshes and the world, as seen from the camera: small parts, each with the irradiance that
it causes there if nothing is in its way."""

from dataclasses import dataclass

import numpy as np

LAMP_PATCHES, WORLD_PATCHES = 16, 2048
GOLDEN_RAD = np.pi * (3 - np.sqrt(5))
PATCH_RAD, CUT_RAD = 0.03, 0.002  # larger triangles are divided: all, and those on the edge of the picture
MOST_TRIANGLES = 8192  # divided up to this number
CORNERS = [[(1, 0, 0), (.5, .5, 0), (.5, 0, .5)], [(.5, .5, 0), (0, 1, 0), (0, .5, .5)],
           [(.5, 0, .5), (0, .5, .5), (0, 0, 1)], [(.5, .5, 0), (0, .5, .5), (.5, 0, .5)]]


@dataclass(frozen=True, eq=False)
class Patches:
    """Parts of one emitter.

    Attributes
    ----------
    vectors : array (patch, 3)
        From the camera, in the world's axes: in Blender units, or unit vectors if `far`.
    irradiance : array (patch,)
        At the camera, on a plane that faces the patch, for an emission of 1: a lamp's relative to its power, otherwise
        a radiance.
    sr : array (patch,)
        Solid angles.
    far : bool
        Whether they are at infinity.
    """

    vectors: np.ndarray
    irradiance: np.ndarray
    sr: np.ndarray
    far: bool = False

    def chosen(self, indices):
        """Some of the patches."""
        return Patches(self.vectors[indices], self.irradiance[indices], self.sr[indices], self.far)


def lamp_patches(light, matrix, origin):
    """Patches of a lamp; None for a lamp around the camera, or in its place.

    Cycles spreads a lamp's power P as these tests state: `tests/addon/job/test_radiometry.py`.

    Parameters
    ----------
    light : bpy.types.Light
    matrix : array (4, 4)
        From the lamp to the world.
    origin : array (3,)
        The camera's place.
    """
    power = light.energy * 2**getattr(light, "exposure", 0.0)
    if light.type == "SUN":
        return _sun(light, matrix, power)
    if light.type == "AREA":
        return _area(light, matrix, power, origin)
    return _point(light, matrix, power, origin)


def _point(light, matrix, power, origin):
    vector, radius = matrix[:3, 3] - origin, light.shadow_soft_size
    distance = np.linalg.norm(vector)
    if distance <= radius:
        return None
    intensity = power / (4 * np.pi) * (4 * np.pi * radius**2 if radius and not _normalised(light) else 1)
    if light.type == "SPOT":
        intensity *= _in_cone(light, np.linalg.pinv(matrix[:3, :3]) @ -vector, matrix)
    sr = 2 * np.pi * (1 - np.sqrt(1 - (radius / distance)**2))
    return _even(_disc(vector, radius), intensity / distance**2, sr)


def _in_cone(light, towards, matrix):
    """A spot's brightness in a direction in its own frame, as a share of that on its axis."""
    scaled = towards * np.linalg.norm(matrix[:3, 2])
    cosine = -scaled[2] / max(np.linalg.norm(scaled), np.finfo(float).tiny)
    edge = np.cos(light.spot_size / 2)
    inside = np.clip((cosine - edge) / max((1 - edge) * light.spot_blend, np.finfo(float).tiny), 0, 1)
    return inside**2 * (3 - 2 * inside)


def _sun(light, matrix, power):
    axis, radius_rad = matrix[:3, 2] / np.linalg.norm(matrix[:3, 2]), light.angle / 2
    sine = np.sin(min(radius_rad, np.pi / 2))
    irradiance = power * (np.pi * sine**2 if sine and not _normalised(light) else 1)
    vectors = _disc(axis, np.tan(min(radius_rad, 1.0)))
    return _even(vectors / np.linalg.norm(vectors, axis=1, keepdims=True), irradiance,
                 2 * np.pi * (1 - np.cos(radius_rad)), far=True)


def _even(vectors, irradiance, sr, far=False):
    share = np.full(len(vectors), 1 / len(vectors))
    return Patches(vectors, irradiance * share, sr * share, far)


def _area(light, matrix, power, origin):
    sides = light.size, light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size
    round_ = light.shape in ("DISK", "ELLIPSE")
    x, y = in_disc().T / 2 if round_ else _in_square().T
    places = matrix[:3, 3] + np.outer(sides[0] * x, matrix[:3, 0]) + np.outer(sides[1] * y, matrix[:3, 1])
    normal = -np.cross(matrix[:3, 0], matrix[:3, 1])
    area = np.linalg.norm(normal) * np.prod(sides) * (np.pi / 4 if round_ else 1)
    if not area:
        return None
    normal = normal / np.linalg.norm(normal) * np.sign(np.dot(np.cross(matrix[:3, 0], matrix[:3, 1]), matrix[:3, 2]))
    vectors = places - origin
    distances = np.linalg.norm(vectors, axis=1)
    if not distances.all():
        return None
    cosines = np.maximum(-vectors @ normal / distances, 0)
    sr = area / len(x) * cosines / distances**2
    radiance = power / np.pi / (area if _normalised(light) else 1)
    return Patches(vectors, radiance * _spread_gain(light.spread, cosines) * sr, sr)


def _spread_gain(spread_rad, cosines):
    """The radiance of an area lamp at angles to its normal, relative to one without a limited spread."""
    half = min(spread_rad / 2, np.pi / 2 - 1e-6)
    slope = 1 / np.tan(half)
    tangents = np.sqrt(np.maximum(1 / np.maximum(cosines, 1e-9)**2 - 1, 0))
    power = np.sin(half)**2 / 2 - slope * (half - np.sin(half) * np.cos(half)) / 2  # of (1 - slope tan) sin cos
    return np.maximum(1 - slope * tangents, 0) / (2 * power)


def _normalised(light):
    """Whether a lamp's power is independent of its size."""
    return getattr(light, "normalize", True)


def mesh_patches(mesh, chosen, matrix, origin, is_cut):
    """Patches of some faces of a mesh, which glow on both sides.

    Parameters
    ----------
    mesh : bpy.types.Mesh
    chosen : array of bool (face,)
    matrix : array (4, 4)
        To the world.
    origin : array (3,)
        The camera's place.
    is_cut : callable
        Whether the picture's edge passes between the corners of triangles, given by vectors from the camera (triangle,
        3, 3): array of bool.
    """
    mesh.calc_loop_triangles()
    faces, corners = np.empty(len(mesh.loop_triangles), int), np.empty(3 * len(mesh.loop_triangles), int)
    places = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.loop_triangles.foreach_get("polygon_index", faces)
    mesh.loop_triangles.foreach_get("vertices", corners)
    mesh.vertices.foreach_get("co", places)
    vectors = places.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3] - origin
    triangles = vectors[corners.reshape(-1, 3)[chosen[faces]]]
    while len(large := _large(triangles, is_cut)) and len(triangles) < MOST_TRIANGLES:
        parts = np.einsum("pcv,tvx->ptcx", np.array(CORNERS), triangles[large]).reshape(-1, 3, 3)
        triangles = np.concatenate([np.delete(triangles, large, axis=0), parts])
    middles = triangles.mean(axis=1)
    crosses = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) / 2
    distances = np.maximum(np.linalg.norm(middles, axis=1), np.finfo(float).tiny)
    sr = np.minimum(np.abs(np.sum(crosses * middles, axis=1)) / distances**3, 2 * np.pi)
    return Patches(middles, sr, sr)


def _large(triangles, is_cut):
    """Indices of the triangles to be divided, by their longest side over their distance."""
    sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=-1).max(axis=1)
    extent_rad = sides / np.maximum(np.linalg.norm(triangles.mean(axis=1), axis=1), np.finfo(float).tiny)
    return np.flatnonzero(extent_rad > np.where(is_cut(triangles), CUT_RAD, PATCH_RAD))


def world_patches(axis):
    """Patches of an even world, in front of a camera with this optical axis."""
    height = (np.arange(WORLD_PATCHES) + 0.5) / WORLD_PATCHES
    turn = np.arange(WORLD_PATCHES) * GOLDEN_RAD
    radius = np.sqrt(1 - height**2)
    across, up = _perpendicular(axis)
    vectors = np.outer(radius * np.cos(turn), across) + np.outer(radius * np.sin(turn), up) + np.outer(height, axis)
    sr = np.full(WORLD_PATCHES, 2 * np.pi / WORLD_PATCHES)
    return Patches(vectors, sr, sr, far=True)


def _disc(vector, radius):
    """Places on a disc around a vector's end that faces its start."""
    across, up = _perpendicular(vector / np.linalg.norm(vector))
    x, y = radius * in_disc().T
    return vector + np.outer(x, across) + np.outer(y, up)


def in_disc():
    """Evenly spread places in the unit disc, from the middle outwards: array (place, 2)."""
    index = np.arange(LAMP_PATCHES)
    turn = index * GOLDEN_RAD
    return np.sqrt((index[:, None] + 0.5) / LAMP_PATCHES) * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def _in_square():
    """Evenly spread places in a square of side 1: array (place, 2)."""
    side = (np.arange(round(np.sqrt(LAMP_PATCHES))) + 0.5) / np.sqrt(LAMP_PATCHES) - 0.5
    return np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)


def _perpendicular(axis):
    """Two unit vectors perpendicular to a unit vector and each other."""
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    return across, np.cross(axis, across)
