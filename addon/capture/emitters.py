"""Emitters in view: where a capture may show lamps and glowing surfaces, however small, and how deep they are.

Cycles finds a pixel's depth with one ray, through the pixel's middle, which misses anything small.
"""

from dataclasses import dataclass, replace

import bpy
import numpy as np

from lensfield.engine.image.directions import directions, holds, places_of, solid_angles_sr
from lensfield.engine.image.layers import BACKGROUND_MM

from ..scene.instances import rendered_instances
from ..scene.patches import lamp_patches, mesh_patches
from ..scene.render_state import rendered_layer
from ..scene.units import mm_per_unit

FAR_MM = 10 * BACKGROUND_MM  # of suns
SAME_DEPTH = 0.02  # relative difference
SMALL_RAD = 4e-3  # an object that appears smaller is a single part: there may be many


@dataclass(frozen=True, eq=False)
class Emitters:
    """Small parts of a scene's emitters.

    Attributes
    ----------
    vectors_mm : array (part, 3)
        From the camera: to the right, up, and along its axis.
    irradiance : array (part,)
        At the camera, on a plane that faces the part: mean over the wavelengths; NaN if unknown.
    """

    vectors_mm: np.ndarray
    irradiance: np.ndarray

    def together(self, other):
        """The parts of both."""
        return Emitters(np.concatenate([self.vectors_mm, other.vectors_mm]),
                        np.concatenate([self.irradiance, other.irradiance]))

    def seen(self, capture):
        """The Sightings in a capture, a PixelGrid with the focal length of its pinhole."""
        inside = holds(capture, self.vectors_mm)
        vectors_mm = self.vectors_mm[inside]
        places = [np.rint(at).astype(int) for at in places_of(capture, vectors_mm)]
        planar_mm = vectors_mm[:, 2]
        clip_mm = planar_mm if capture.projection.is_plane else np.linalg.norm(vectors_mm, axis=1)
        planar_mm, clip_mm = (np.where(depth >= BACKGROUND_MM, np.inf, depth) for depth in (planar_mm, clip_mm))
        return Sightings(*places, planar_mm, clip_mm, self.irradiance[inside] / solid_angles_sr(capture, *places))


@dataclass(frozen=True, eq=False)
class Sightings:
    """Parts of emitters at the pixels of a capture, unless something hides them.

    Attributes
    ----------
    row, column : int arrays (part,)
    planar_mm, clip_mm : arrays (part,)
        Depth along the axis, and as the camera clips; inf for suns.
    light : array (part,)
        Mean radiance over the pixel; NaN if unknown.
    """

    row: np.ndarray
    column: np.ndarray
    planar_mm: np.ndarray
    clip_mm: np.ndarray
    light: np.ndarray

    def chosen(self, parts):
        """Some of the parts."""
        return Sightings(*(values[parts] for values in vars(self).values()))

    def at_shape(self, shape_px, fewer_px):
        """The same parts at the larger pixels of the same area, which has this shape in them."""
        row, column = (at * few // count for at, few, count in
                       zip((self.row, self.column), fewer_px, shape_px, strict=True))
        return Sightings(row, column, self.planar_mm, self.clip_mm,
                         self.light * np.prod(np.divide(fewer_px, shape_px)))

    def _known_in(self, planar_mm):
        """Whether a look has their depths next to them: array of bool (part,)."""
        around = np.pad(planar_mm, 1, constant_values=np.nan)
        with np.errstate(invalid="ignore"):
            return np.any([np.abs(around[self.row + down, self.column + across] / self.planar_mm - 1) < SAME_DEPTH
                           for down, across in np.ndindex(3, 3)], axis=0)

    def laid_over(self, planar_mm, light):
        """A look at depth and light, arrays (row, column), with the parts that it misses and that nothing hides in it.

        A part with unknown light is as bright as the mean lit pixel.
        """
        planar_mm, light = np.array(planar_mm, float), np.array(light, float)
        usual = light[light > 0].mean() if np.any(light > 0) else 1.0
        part = self.chosen(~(self.planar_mm > planar_mm[self.row, self.column]) & ~self._known_in(planar_mm))
        at, added = (part.row, part.column), np.zeros_like(light)
        np.add.at(added, at, np.where(np.isnan(part.light), usual, part.light))
        nearest_mm = np.full_like(planar_mm, np.inf)
        np.minimum.at(nearest_mm, at, part.planar_mm)
        return np.fmin(planar_mm, nearest_mm), np.maximum(light, added)


def emitters_of(scene, emission_of):
    """The Emitters of a scene that the camera shows, except its world.

    Parameters
    ----------
    scene : bpy.types.Scene
        Evaluated at the frame.
    emission_of : callable (material or lamp)
        Its emission at some wavelengths, as `Substitution.emission_at` returns it: None if it is unknown.

    Returns
    -------
    Emitters
    """
    to_world = scene.camera.matrix_world.normalized()
    origin, (right, up, back) = np.array(to_world.translation), np.array(to_world.to_3x3()).T
    axes, unit_mm = np.stack([right, up, -back]), mm_per_unit(scene)
    parts = [Emitters(np.zeros((0, 3)), np.zeros(0))]
    for vectors, irradiance, far in _parts(scene, origin, _Emissions(emission_of)):
        parts.append(Emitters(vectors @ axes.T * (FAR_MM if far else unit_mm), irradiance))
    return Emitters(*(np.concatenate(values) for values in zip(*(vars(each).values() for each in parts), strict=True)))


def emitters_in(radiance, planar_mm, chosen):
    """The light of some pixels as Emitters.

    Parameters
    ----------
    radiance : SpectralImage
        A capture.
    planar_mm : array (row, column)
        inf for the background.
    chosen : array of bool (row, column)
    """
    capture = replace(radiance.grid, focal_mm=radiance.focal_mm)
    row, column = np.nonzero(chosen)
    towards = directions(capture, row, column)
    ahead = towards[:, 2] > 0  # a fisheye shows more
    row, column, towards = row[ahead], column[ahead], towards[ahead]
    depth_mm = np.minimum(planar_mm[row, column], FAR_MM)
    light = radiance.cube[:, row, column].mean(axis=0) * solid_angles_sr(capture, row, column)
    return Emitters(towards / towards[:, 2:] * depth_mm[:, None], light)


class _Emissions:
    """Mean emissions of materials and lamps, each computed once: NaN if unknown."""

    def __init__(self, emission_of):
        self._emission_of, self._known = emission_of, {}

    def of(self, block):
        if block not in self._known:
            emission = self._emission_of(block)
            self._known[block] = np.nan if emission is None else float(np.mean(emission))
        return self._known[block]


def _parts(scene, origin, emissions):
    """(vectors from the camera in Blender units, irradiance, whether they are at infinity) of each emitter."""
    layer, glows = rendered_layer(scene), {}
    for instance in rendered_instances(scene):
        if not instance.obj.visible_camera:
            continue
        if instance.obj.type == "LIGHT":
            patches = _lamp(instance, emissions, origin)
            if patches is not None:
                yield patches.vectors, emissions.of(instance.obj.data) * patches.irradiance, patches.far
        elif any(emissions.of(material) for material in instance.materials):
            yield from _object(instance, emissions, origin, layer, glows)


def _lamp(instance, emissions, origin):
    lamp = instance.obj.data
    portal = lamp.type == "AREA" and lamp.cycles.is_portal
    if portal or not has_size(lamp) or not lamp.energy or not emissions.of(lamp):
        return None
    return lamp_patches(lamp, instance.matrix_world, origin)


def _object(instance, emissions, origin, layer, glows):
    box = instance.box - origin
    middle, is_mesh = box.mean(axis=0), isinstance(instance.data, bpy.types.Mesh)
    distance = np.linalg.norm(middle)
    if is_mesh and np.linalg.norm(np.ptp(box, axis=0)) < SMALL_RAD * distance:
        key = instance.data, instance.materials
        if key not in glows:
            glows[key] = _glow(instance, emissions, layer)
        scale = np.abs(np.linalg.det(instance.matrix_world[:3, :3])) ** (2 / 3)
        yield middle[None], np.array([glows[key] * scale / distance**2]), False
    elif is_mesh:
        yield from _surfaces(instance, emissions, origin, layer)
    else:
        vectors = np.append(box, middle[None], axis=0)
        yield vectors, np.full(len(vectors), np.nan), False


def _glow(instance, emissions, layer):
    """The emission of a mesh's faces times their area: its irradiance at a distance of 1, at most."""
    areas = np.empty(len(instance.data.polygons), np.float32)
    instance.data.polygons.foreach_get("area", areas)
    return sum(emissions.of(material) * float(areas[faces].sum())
               for material, faces in faces_of_materials(instance, layer) if material)


def _surfaces(instance, emissions, origin, layer):
    for material, faces in faces_of_materials(instance, layer):
        emission = emissions.of(material) if material else 0.0
        if emission and faces.any():
            patches = mesh_patches(instance.data, faces, instance.matrix_world, origin, _uncut)
            yield patches.vectors, emission * patches.irradiance, False


def _uncut(triangles):
    return np.zeros(len(triangles), bool)


def has_size(lamp):
    """Whether a lamp that the camera shows makes an image: points do not."""
    return lamp.type == "AREA" or (lamp.angle if lamp.type == "SUN" else lamp.shadow_soft_size) > 0


def faces_of_materials(instance, layer):
    """(material or None, array of bool (face,)) for each slot of a mesh's Instance, as a view layer renders it."""
    mesh, override = instance.data, layer.material_override
    slots = [material and material.original for material in mesh.materials]
    for index, slot in enumerate(instance.obj.material_slots[:len(slots)]):
        if slot.link == "OBJECT":
            slots[index] = slot.material
    slots = [override] if override else slots
    used = np.zeros(len(mesh.polygons), np.int32)
    if not override and "material_index" in mesh.attributes:
        mesh.polygons.foreach_get("material_index", used)
    used = np.clip(used, 0, max(len(slots) - 1, 0))
    for index, material in enumerate(slots):
        yield material, used == index
