"""What one depth for each pixel does not tell: what is seen through glass, in mirrors and in volumes, found by rays.

A render's depth is that of the first surface. What lies behind glass, or is reflected, is blurred as if it were on that
surface; and the light of fog as if it came from what lies behind it. That counts where the two are blurred otherwise.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from ...engine.image.depth_range import blur_per_nearness_px, entrance_pupil_diameter_mm
from ..scene.depth import BEYOND_M, M_TO_MM, View
from ..scene.instances import rendered_instances
from ..scene.render_state import rendered_layer
from ..shading.lobes import MIRRORED, REFRACTED, STRAIGHT, glows_within, has_surface, lobes_of

VOLUME = "volume"
SHOWN = 0.1  # of a surface's light: less of a lobe is no picture
MOST_SURFACES = 16  # that a ray goes through
BLUR_PX = 1.0  # by which two depths have to differ
BENDING = 0.5  # glass's index, less 1
SEEN_AS = {REFRACTED: "visible_transmission", MIRRORED: "visible_glossy"}


@dataclass(frozen=True)
class Unlayered:
    """What a depth does not tell, of one kind.

    Attributes
    ----------
    share : float
        Of the picture.
    names : tuple of str
        The objects, those that most of it is seen in first; () for the world's volume.
    """

    share: float
    names: tuple[str, ...]


def unlayered(scene, lens, capture):
    """What of a picture is blurred by another distance than its own, before it is rendered.

    Parameters
    ----------
    scene : bpy.types.Scene
    lens : Lens
    capture : PixelGrid

    Returns
    -------
    dict
        REFRACTED, MIRRORED and VOLUME to their Unlayered, where there is any.
    """
    look = _Look(scene, lens, capture)
    boxes, volumes = look.candidates()
    rays = np.flatnonzero(np.isfinite([*boxes, *(entered_m for _, entered_m in volumes)]).any(axis=0))
    seen = look.view.look(look.along, rays)
    share, cast = rays.size / len(look.view.directions) / max(len(seen), 1), rays[:len(seen)]
    depths_m = np.array([depth_m for depth_m, *_ in seen])
    found = [(kind, name, ray) for ray, (_, kind, name) in zip(cast, seen, strict=True)]
    found += [(VOLUME, name, ray) for name, entered_m in volumes
              for ray in cast[look.is_elsewhere(look.view.cosines[cast] * entered_m[cast], depths_m)]]
    return {kind: Unlayered(share * len({ray for of_kind, _, ray in found if of_kind == kind}),
                            tuple(name for name, _ in Counter(
                                name for of_kind, name, _ in found if of_kind == kind and name).most_common()))
            for kind in dict.fromkeys(kind for kind, *_ in found) if kind}


class _Look:
    """A look along the rays of a camera."""

    def __init__(self, scene, lens, capture):
        self.view, self._scene, self._layer = View(scene, lens, capture), scene, rendered_layer(scene)
        self._pupil_m = entrance_pupil_diameter_mm(lens) / M_TO_MM
        self._blur_px_m = blur_per_nearness_px(lens, capture.pitch_um) / M_TO_MM
        self._lobes, self._glows = {}, {}

    def candidates(self):
        """How far along each ray the bounding boxes of what may be glass or a mirror begin: list of array; and of what
        has a volume, after its name, "" for the world's."""
        none = np.full(len(self.view.directions), np.inf)
        boxes, world = [none], self._layer.world_override or self._scene.world
        volumes = [("", np.zeros_like(none))] if world and glows_within(world) else []
        for instance in rendered_instances(self._scene):
            is_volume = self._is_volume(instance)
            if is_volume or any(map(self._shows_more, instance.materials)):
                entered_m = _entered_m(instance, self.view.origin, self.view.directions)
                boxes.append(entered_m)
                volumes += [(instance.obj.name, entered_m)] * is_volume
        return boxes, volumes

    def along(self, ray, direction):
        """The depth in metres that a ray's pixel has; and what that does not tell: the kind, and the object's name,
        both "" for nothing."""
        hit, cosine = self._with_depth(direction), self.view.cosines[ray]
        if hit is None:
            return np.inf, "", ""
        distance_m = max((hit.place - self.view.origin).length, BEYOND_M)
        lobe = self._picture(hit, distance_m)
        apart = abs(1 / distance_m - _nearness(distance_m, *self._beyond(hit, direction, lobe.way))) if lobe else 0.0
        told = apart * self._blur_px_m / cosine <= BLUR_PX
        return distance_m * cosine, *(("", "") if told else (lobe.way, hit.obj.original.name))

    def is_elsewhere(self, first_m, depths_m):
        """Whether what begins at a depth, before that of a pixel, is blurred otherwise."""
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
        """The Hit that a depth pass has: surfaces that are nearly transparent have none."""
        start = self.view.origin
        for _ in range(MOST_SURFACES):
            hit = self.view.first(start, direction)
            if hit is None or self._covers(hit):
                return hit
            start = hit.place + direction * BEYOND_M
        return None

    def _covers(self, hit):
        lobes = self._lobes_of(hit)
        if lobes is None:
            return False
        covered = 1 - sum(lobe.share for lobe in lobes if lobe.way == STRAIGHT)
        return covered > 0 and covered >= self._layer.pass_alpha_threshold

    def _picture(self, hit, distance_m):
        """The Lobe that shows most of something else, where it is not too rough for any focus to be seen in it."""
        spread = self._pupil_m / distance_m  # the angle that the pupil is seen under from there
        shown = [lobe for lobe in self._lobes_of(hit) if lobe.way != STRAIGHT and lobe.share >= SHOWN
                 and 2 * lobe.roughness**2 < spread]
        return max(shown, key=lambda lobe: lobe.share, default=None)

    def _beyond(self, hit, direction, way):
        """How far behind a surface what is seen there lies, in metres along the ray, and the power in 1/m of all that
        the light is bent by."""
        if way == MIRRORED:
            outside = hit.normal.dot(direction) < 0
            power = 2 * _curvature(hit) * (-1 if outside else 1)
            direction = direction - 2 * direction.dot(hit.normal) * hit.normal
        else:
            power = BENDING * _curvature(hit)
        place = hit.place
        for _ in range(MOST_SURFACES):
            further = self.view.first(place + direction * BEYOND_M, direction, SEEN_AS[way])
            if further is None:
                return np.inf, power
            place = further.place
            if way == REFRACTED and self._refracts(further):
                power += BENDING * _curvature(further)
            elif self._covers(further):
                break
        return (place - hit.place).length, power

    def _refracts(self, hit):
        return any(lobe.way == REFRACTED and lobe.share >= SHOWN for lobe in self._lobes_of(hit) or ())

    def _lobes_of(self, hit):
        return self._lobes_of_material(self._layer.material_override or _material(hit))

    def _lobes_of_material(self, material):
        """The Lobes of its surface; None where it has none."""
        if material not in self._lobes:
            self._lobes[material] = [] if material is None else lobes_of(material) if has_surface(material) else None
        return self._lobes[material]


def _material(hit):
    slots, index = hit.obj.material_slots, 0
    if hit.obj.type == "MESH" and 0 <= hit.face < len(hit.obj.data.polygons):
        index = hit.obj.data.polygons[hit.face].material_index
    return slots[min(index, len(slots) - 1)].material if slots else None


def _curvature(hit):
    """The mean curvature of a smooth face, in 1/m: positive where it bulges to the side of its normal."""
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
    """1 / distance at which something appears that lies so far beyond a surface of this power."""
    vergence = 1 / max(beyond_m, BEYOND_M) - power
    stretch = 1 + distance_m * vergence
    return vergence / stretch if stretch else np.inf


def _entered_m(instance, origin, directions):
    """How far along rays a bounding box is entered, 0 from inside; inf where it is missed: array."""
    to_box = np.linalg.pinv(instance.matrix_world)
    start, along = to_box[:3, :3] @ origin + to_box[:3, 3], directions @ to_box[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (np.stack([instance.corners.min(axis=0), instance.corners.max(axis=0)])[:, None] - start) / along
    first, last = np.fmin(*ends).max(axis=1), np.fmax(*ends).min(axis=1)
    return np.where((first <= last) & (last > 0), np.maximum(first, 0), np.inf)
