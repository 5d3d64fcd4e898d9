"""Content that one depth for each pixel misses, found by rays: scenes behind glass, reflections, and volumes.

A render's depth belongs to the first surface. Objects behind glass, and reflected ones, are blurred as if they were on
that surface; and the light of fog as if it came from the surface behind it. Only a difference in blur counts.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from lensfield.engine.depth.depth_range import blur_per_nearness_px
from lensfield.engine.lens.entrance_pupil import entrance_pupil_diameter_mm

from ..scene.depth import BEYOND_M, View
from ..scene.instances import rendered_instances
from ..scene.render_state import rendered_layer
from ..scene.units import M_TO_MM
from ..shading.lobes import MIRRORED, REFRACTED, STRAIGHT, glows_within, has_surface, lobes_of

VOLUME = "volume"
SHOWN = 0.1  # least share of a surface's light for a lobe to count
MOST_SURFACES = 16  # that a ray passes through
BLUR_PX = 1.0  # least difference in blur between two depths for it to count
BENDING = 0.5  # refractive index of glass, minus 1
VISIBILITY = {REFRACTED: "visible_transmission", MIRRORED: "visible_glossy"}


@dataclass(frozen=True)
class Unlayered:
    """Content of one kind that a pixel's depth misses.

    Attributes
    ----------
    share : float
        Fraction of the picture.
    names : tuple of str
        The objects, largest share first; () for the world's volume.
    """

    share: float
    names: tuple[str, ...]


def unlayered(scene, lens, capture, others=()):
    """Content of a picture that would be blurred for a wrong distance, estimated before the render.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens
    capture : PixelGrid
    others : sequence of Lens
        Further lenses for the same capture: content counts if one of all the lenses would blur it wrongly.

    Returns
    -------
    dict
        REFRACTED, MIRRORED and VOLUME to their Unlayered; kinds that do not occur are left out.
    """
    look = _Look(scene, lens, capture, others)
    boxes, volumes = look.candidates()
    rays = np.flatnonzero(np.isfinite([*boxes, *(entered_m for _, entered_m in volumes)]).any(axis=0))
    results = look.view.look(look.along, rays)
    share, cast = rays.size / len(look.view.directions) / max(len(results), 1), rays[:len(results)]
    depths_m = np.array([depth_m for depth_m, *_ in results])
    content = [(kind, name, ray) for ray, (_, kind, name) in zip(cast, results, strict=True)]
    content += [(VOLUME, name, ray) for name, entered_m in volumes
                for ray in cast[look.is_elsewhere(look.view.cosines[cast] * entered_m[cast], depths_m)]]
    return {kind: Unlayered(share * len({ray for of_kind, _, ray in content if of_kind == kind}),
                            tuple(name for name, _ in Counter(
                                name for of_kind, name, _ in content if of_kind == kind and name).most_common()))
            for kind in dict.fromkeys(kind for kind, *_ in content) if kind}


class _Look:
    """Casts the rays of a camera."""

    def __init__(self, scene, lens, capture, others):
        self.view, self._scene, self._layer = View(scene, lens, capture), scene, rendered_layer(scene)
        lenses = lens, *others
        self._pupil_m = max(map(entrance_pupil_diameter_mm, lenses)) / M_TO_MM
        self._blur_px_m = max(blur_per_nearness_px(each, capture.pitch_um) for each in lenses) / M_TO_MM
        self._lobes, self._glows = {}, {}

    def candidates(self):
        """Distances along each ray, in metres, to the bounding boxes of possible glass, mirrors and volumes: list of
        arrays; and (name, array) for each volume, with "" as the name of the world."""
        none = np.full(len(self.view.directions), np.inf)
        boxes, world = [none], self._layer.world_override or self._scene.world
        volumes = [("", np.zeros_like(none))] if world and glows_within(world) else []
        for instance in rendered_instances(self._scene):
            is_volume = self._is_volume(instance)
            if is_volume or any(map(self._shows_more, instance.materials)):
                entered_m = _entered(instance, self.view.origin, self.view.directions) * self.view.unit_m
                boxes.append(entered_m)
                volumes += [(instance.obj.name, entered_m)] * is_volume
        return boxes, volumes

    def along(self, ray, direction):
        """The depth of a ray's pixel in metres; and, if this depth misses content, its kind and the name of the surface
        that shows it, else "" for both."""
        hit, cosine = self._with_depth(direction), self.view.cosines[ray]
        if hit is None:
            return np.inf, "", ""
        distance_m = max((hit.place - self.view.origin).length * self.view.unit_m, BEYOND_M)
        lobe = self._picture(hit, distance_m)
        apart = abs(1 / distance_m - _nearness(distance_m, *self._beyond(hit, direction, lobe.way))) if lobe else 0.0
        negligible = apart * self._blur_px_m / cosine <= BLUR_PX
        return distance_m * cosine, *(("", "") if negligible else (lobe.way, hit.obj.original.name))

    def is_elsewhere(self, first_m, depths_m):
        """Whether content that begins at `first_m`, in front of a pixel's depth, has a different blur."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return (first_m < depths_m) & (self._blur_px_m * (1 / first_m - 1 / depths_m) > BLUR_PX)

    def _is_volume(self, instance):
        if instance.obj.type == "VOLUME" and not instance.materials:
            return True  # Cycles gives it a volume shader
        for material in instance.materials - self._glows.keys():
            self._glows[material] = glows_within(material)
        return any(self._glows[material] for material in instance.materials)

    def _shows_more(self, material):
        return any(lobe.way != STRAIGHT and lobe.share >= SHOWN for lobe in self._lobes_of_material(material) or ())

    def _with_depth(self, direction):
        """The Hit that a depth pass records: it ignores surfaces that are nearly transparent."""
        start = self.view.origin
        for _ in range(MOST_SURFACES):
            hit = self.view.first(start, direction)
            if hit is None or self._covers(hit):
                return hit
            start = hit.place + direction * self.view.beyond_units
        return None

    def _covers(self, hit):
        lobes = self._lobes_of(hit)
        if lobes is None:
            return False
        covered = 1 - sum(lobe.share for lobe in lobes if lobe.way == STRAIGHT)
        return covered > 0 and covered >= self._layer.pass_alpha_threshold

    def _picture(self, hit, distance_m):
        """The strongest Lobe that shows other objects; one too rough for focus to matter does not count."""
        spread = self._pupil_m / distance_m  # the angle that the pupil subtends at the surface
        shown = [lobe for lobe in self._lobes_of(hit) if lobe.way != STRAIGHT and lobe.share >= SHOWN
                 and 2 * lobe.roughness**2 < spread]
        return max(shown, key=lambda lobe: lobe.share, default=None)

    def _beyond(self, hit, direction, way):
        """Distance in metres along the ray from a surface to the object visible in it, and the power in 1/m of all
        surfaces that bend the light."""
        if way == MIRRORED:
            outside = hit.normal.dot(direction) < 0
            power = 2 * self._curvature_per_m(hit) * (-1 if outside else 1)
            direction = direction - 2 * direction.dot(hit.normal) * hit.normal
        else:
            power = BENDING * self._curvature_per_m(hit)
        place = hit.place
        for _ in range(MOST_SURFACES):
            further = self.view.first(place + direction * self.view.beyond_units, direction, VISIBILITY[way])
            if further is None:
                return np.inf, power
            place = further.place
            if way == REFRACTED and self._refracts(further):
                power += BENDING * self._curvature_per_m(further)
            elif self._covers(further):
                break
        return (place - hit.place).length * self.view.unit_m, power

    def _curvature_per_m(self, hit):
        return _curvature(hit) / self.view.unit_m

    def _refracts(self, hit):
        return any(lobe.way == REFRACTED and lobe.share >= SHOWN for lobe in self._lobes_of(hit) or ())

    def _lobes_of(self, hit):
        return self._lobes_of_material(self._layer.material_override or material_of(hit))

    def _lobes_of_material(self, material):
        """The Lobes of a material's surface; None without a surface."""
        if material not in self._lobes:
            self._lobes[material] = [] if material is None else lobes_of(material) if has_surface(material) else None
        return self._lobes[material]


def material_of(hit):
    """The material of a Hit, or None."""
    slots, index = hit.obj.material_slots, 0
    if hit.obj.type == "MESH" and 0 <= hit.face < len(hit.obj.data.polygons):
        index = hit.obj.data.polygons[hit.face].material_index
    return slots[min(index, len(slots) - 1)].material if slots else None


def _curvature(hit):
    """The mean curvature of a smooth face, per Blender unit: positive if the face bulges towards its normal."""
    if hit.obj.type != "MESH" or not 0 <= hit.face < len(hit.obj.data.polygons):
        return 0.0
    mesh = hit.obj.data
    polygon, turn = mesh.polygons[hit.face], np.array(hit.to_world)[:3, :3]
    normals = np.array([mesh.corner_normals[loop].vector for loop in polygon.loop_indices])
    places = np.array([mesh.vertices[vertex].co for vertex in polygon.vertices]) @ turn.T
    normals = normals @ np.linalg.pinv(turn)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    edges = np.roll(places, -1, axis=0) - places
    turns = np.sum((np.roll(normals, -1, axis=0) - normals) * edges, axis=1)
    return float(turns.sum() / max(np.sum(edges**2), np.finfo(float).tiny))


def _nearness(distance_m, beyond_m, power):
    """1 / apparent distance of an object `beyond_m` behind a surface of this power."""
    vergence = 1 / max(beyond_m, BEYOND_M) - power
    stretch = 1 + distance_m * vergence
    return vergence / stretch if stretch else np.inf


def _entered(instance, origin, directions):
    """Distance along each ray to a bounding box, in Blender units: array; 0 from inside, inf for a miss."""
    to_box = np.linalg.pinv(instance.matrix_world)
    start, along = to_box[:3, :3] @ origin + to_box[:3, 3], directions @ to_box[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (np.stack([instance.corners.min(axis=0), instance.corners.max(axis=0)])[:, None] - start) / along
    first, last = np.fmin(*ends).max(axis=1), np.fmax(*ends).min(axis=1)
    return np.where((first <= last) & (last > 0), np.maximum(first, 0), np.inf)
