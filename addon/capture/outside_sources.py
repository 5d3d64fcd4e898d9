"""Sources of stray light that a capture does not contain: lamps, glowing meshes and the world.

The picture contains what the camera shows, so such an object is a source only beyond the capture's edges. An object
that the camera does not show, as Blender's lamps by default, is a source wherever it is in front of the lens. Lamps
with light linking are not, because they light their receivers only.

Rays from several places in the entrance pupil find obstacles. Glass and transparent surfaces let their share of the
light pass, straight ahead.
"""

from dataclasses import dataclass, replace

import bpy
import numpy as np
from mathutils import Vector

from lensfield.engine.image.directions import directions, holds, solid_angles_sr
from lensfield.engine.image.sources import Sources, widths_nm
from lensfield.engine.lens.entrance_pupil import entrance_pupil_size_mm
from lensfield.engine.runtime.errors import listed
from lensfield.engine.stray.merging import grouped, merged_sources

from ..scene.depth import View
from ..scene.instances import rendered_instances
from ..scene.patches import LAMP_PATCHES, Patches, in_disc, lamp_patches, mesh_patches, world_patches
from ..scene.render_state import rendered_layer, rendered_world
from ..scene.units import mm_per_unit
from ..shading.lobes import MIRRORED, has_surface, lobes_of
from .emitters import faces_of_materials, has_size
from .sky import is_computed, sky_steps
from .unlayered import material_of

MOST_OUTSIDE = 256
MOST_PARTS, PART_RAD = 64, 0.03  # of one emitter
MOST_RAYS, MANY_OBJECTS = 4096, 256  # in larger scenes, where each ray takes longer, fewer in proportion
PUPIL_STEP = 7  # between the places of consecutive rays: patches and places follow the same spiral
MOST_SURFACES = 8  # that one ray may pass
NEARLY = 1 - 1e-4  # of the distance to a patch: its own surface is not in the way
MOST_NAMED = 3


def outside_steps(ready, capture, needed):
    """Steps that find the sources of a scene that is ready for its passes; returns what `outside_sources` returns, or
    None for the sources if they take renders and are not needed.

    Parameters
    ----------
    ready : Ready
    capture : PixelGrid
    needed : bool
        Whether the lens image has stray light.
    """
    scene, sky = ready.scene, None
    if shows_world(scene) and is_computed(ready):
        if not needed:
            return None, ()
        sky = yield from sky_steps(ready)
    return outside_sources(scene, ready.job, ready.substitution, capture, sky)


def outside_sources(scene, job, substitution, capture, sky=None):
    """The sources of stray light in a scene that a capture does not contain.

    Parameters
    ----------
    scene : bpy.types.Scene
        Evaluated at the frame, with the stand-ins of `substitution`.
    job : Job
    substitution : Substitution
    capture : PixelGrid
        The capture, with its focal length.
    sky : SpectralImage, optional
        From `sky_steps`.

    Returns
    -------
    Sources
        At most `MOST_OUTSIDE`; more are merged with their neighbours.
    tuple of str
        A line for emitters that are not counted.
    """
    sight = _Sight(scene, job.lens, capture)
    emitters, uncounted, objects = _emitters(scene, substitution, job.wavelengths_nm, sight, sky)
    parts = [part for emitter in emitters for part in sight.parts(emitter)]
    rays = MOST_RAYS * MANY_OBJECTS // (max(objects, MANY_OBJECTS) * max(len(parts), 1))
    rays = int(np.clip(rays, 1, LAMP_PATCHES))
    sources = [sight.source(part, rays, job.wavelengths_nm) for part in parts]
    merged = merged_sources(Sources.together([_none(job.wavelengths_nm), *filter(None, sources)]), MOST_OUTSIDE)
    return merged, tuple(_line(why, names) for why, names in uncounted.items() if names)


@dataclass(frozen=True, eq=False)
class _Emitter:
    """Patches of one emitter.

    Attributes
    ----------
    name : str
    patches : Patches
    spectrum : array (wavelength,) or (patch, wavelength)
        For an irradiance of 1.
    shown : bool
        Whether the camera shows it.
    """

    name: str
    patches: Patches
    spectrum: np.ndarray
    shown: bool

    def chosen(self, indices):
        """Some of its patches."""
        spectrum = self.spectrum if self.spectrum.ndim == 1 else self.spectrum[indices]
        return replace(self, patches=self.patches.chosen(indices), spectrum=spectrum)


def _emitters(scene, substitution, wavelengths_nm, sight, sky):
    """The emitters of a scene: list; the names of those that are not counted, by reason; and the number of objects."""
    computed, not_mesh, linked = uncounted = {}, {}, {}
    emissions, emitters, instances = {}, [], list(rendered_instances(scene))

    def emission_of(block):
        if block not in emissions:
            emissions[block] = substitution.emission_at(block, np.asarray(wavelengths_nm, float))
        return emissions[block]

    for instance in instances:
        if instance.obj.type == "LIGHT":
            emitters += _lamp(instance, emission_of, sight, computed, linked)
        elif any(emission_of(material) is None or emission_of(material).any() for material in instance.materials):
            emitters += _mesh(instance, emission_of, sight, computed, not_mesh)
    if sky is not None:
        emitters.append(_of_sky(sky, sight))
    elif shows_world(scene):
        emission = emission_of(rendered_world(scene))
        if emission.any():
            emitters.append(_Emitter("world", world_patches(sight.axis), emission, True))
    reasons = ("nodes compute their light", "they are not meshes", "they light only linked objects")
    return emitters, dict(zip(reasons, uncounted, strict=True)), len(instances)


def shows_world(scene):
    """Whether the camera sees a world."""
    world = rendered_world(scene)
    return world is not None and world.cycles_visibility.camera and not scene.render.film_transparent


def _of_sky(sky, sight):
    """The Emitter of a sky that was rendered: its pixels."""
    indices = np.indices(sky.cube.shape[1:]).reshape(2, -1)
    grid = replace(sky.grid, focal_mm=sky.focal_mm)
    widths, sr = widths_nm(sky.wavelengths_nm), solid_angles_sr(grid, *indices)
    radiance = np.maximum(sky.cube.reshape(len(sky.cube), -1).T, 0)
    mean = radiance @ widths / widths.sum()
    spectrum = np.divide(radiance, mean[:, None], out=np.zeros_like(radiance), where=mean[:, None] > 0)
    return _Emitter("world", Patches(directions(grid, *indices) @ sight.axes, mean * sr, sr, far=True), spectrum, True)


def _lamp(instance, emission_of, sight, computed, linked):
    lamp, name = instance.obj.data, instance.obj.name
    emission = emission_of(lamp)
    if emission is None:
        computed[f"light {name!r}"] = None
    elif instance.obj.light_linking.receiver_collection:
        linked[f"light {name!r}"] = None
    elif emission.any() and lamp.energy and not (lamp.type == "AREA" and lamp.cycles.is_portal):
        patches = lamp_patches(lamp, instance.matrix_world, sight.origin)
        if patches:
            yield _Emitter(name, patches, emission, instance.obj.visible_camera and has_size(lamp))


def _mesh(instance, emission_of, sight, computed, not_mesh):
    mesh, name = instance.data, f"object {instance.obj.name!r}"
    if not isinstance(mesh, bpy.types.Mesh):
        not_mesh[name] = None
        return
    for material, faces in faces_of_materials(instance, sight.layer):
        emission = emission_of(material) if material else np.zeros(1)
        if not faces.any():
            continue
        if emission is None:
            computed[name] = None
        elif emission.any():
            yield _Emitter(instance.obj.name, mesh_patches(mesh, faces, instance.matrix_world, sight.origin,
                                                            sight.is_cut), emission, instance.obj.visible_camera)


class _Sight(View):
    """The light in front of a lens that reaches its entrance pupil.

    Parameters
    ----------
    scene, lens
    capture : PixelGrid
        The capture, with its focal length.
    """

    def __init__(self, scene, lens, capture):
        super().__init__(scene, lens, capture)
        self.layer, self._capture, self._unit_mm = rendered_layer(scene), capture, mm_per_unit(scene)
        right, up, back = np.array(scene.camera.matrix_world.normalized().to_3x3()).T
        self.axis, self.axes = -back, np.stack([right, up, -back])
        x, y = (np.array(entrance_pupil_size_mm(lens)) / 2 / self._unit_mm)[:, None] * in_disc().T
        self._pupil = np.outer(x, right) + np.outer(y, up)
        self._passed = {}

    def parts(self, emitter):
        """The parts of an emitter in front of the lens that the capture does not contain: Emitters, each small."""
        patches = emitter.patches
        towards = self._towards(patches.vectors)
        counted = (patches.irradiance > 0) & (patches.irradiance < np.inf) & (towards[:, 2] > 0)
        if emitter.shown:
            counted &= ~holds(self._capture, towards)
        emitter, towards = emitter.chosen(counted), towards[counted]
        for group in grouped(towards, patches.irradiance[counted], MOST_PARTS, PART_RAD):
            yield emitter.chosen(group)

    def source(self, part, rays, wavelengths_nm):
        """The source that a part of an emitter is, by this number of rays; None if all are blocked. The rays share its
        light equally."""
        patches, towards = part.patches, self._towards(part.patches.vectors)
        light = np.cumsum(patches.irradiance)
        aimed = np.searchsorted(light, light[-1] * (np.arange(rays) + 0.5) / rays)
        passed = np.array([self._reaches(patches.vectors[index], patches.far, ray) for ray, index in enumerate(aimed)])
        if not passed.any():
            return None
        share, passing = patches.irradiance / light[-1], passed / passed.sum()
        middle = share @ towards
        extent_sr = share @ (2 * np.pi * np.square(towards - middle).sum(axis=1) + patches.sr)
        middle += (passing - 1 / rays) @ towards[aimed]
        distance = np.inf if patches.far else passing @ np.linalg.norm(patches.vectors[aimed], axis=1)
        irradiance = patches.irradiance @ (part.spectrum if part.spectrum.ndim > 1 else
                                           np.broadcast_to(part.spectrum, (len(light), part.spectrum.size)))
        return Sources((middle / np.linalg.norm(middle))[None], np.array([distance * self._unit_mm]),
                       passed.mean() * irradiance[None], np.asarray(wavelengths_nm, float),
                       np.array([np.sqrt(extent_sr / np.pi)]), (part.name,))

    def is_cut(self, triangles):
        """Whether the capture contains some of the corners of triangles, given as vectors from the camera."""
        inside = holds(self._capture, self._towards(triangles))
        return inside.any(axis=-1) & ~inside.all(axis=-1)

    def _towards(self, vectors):
        """Directions of vectors (..., 3) from the camera, in its axes."""
        towards = vectors @ self.axes.T
        return towards / np.maximum(np.linalg.norm(towards, axis=-1, keepdims=True), np.finfo(float).tiny)

    def _reaches(self, vector, far, ray):
        """The share of a patch's light that reaches one of the places in the pupil."""
        start = self._pupil[ray * PUPIL_STEP % LAMP_PATCHES]
        direction = Vector(vector if far else vector - start)
        left, share = np.inf if far else direction.length * NEARLY, 1.0
        direction.normalize()
        place = self.origin + Vector(start)
        for _ in range(MOST_SURFACES):
            hit = self.first(place, direction)
            if hit is None or (hit.place - place).length >= left:
                return share
            share *= self._share_through(hit)
            if not share:
                return 0.0
            left -= (hit.place - place).length + self.beyond_units
            place = hit.place + direction * self.beyond_units
        return 0.0

    def _share_through(self, hit):
        """The share of light that passes a surface, as through clear glass."""
        material = self.layer.material_override or material_of(hit)
        if material not in self._passed:
            lobes = [] if material is None else lobes_of(material)
            share = sum(lobe.share for lobe in lobes if lobe.way != MIRRORED)
            self._passed[material] = share if material is None or has_surface(material) else 1.0
        return self._passed[material]


def _none(wavelengths_nm):
    nm = np.asarray(wavelengths_nm, float)
    return Sources(np.zeros((0, 3)), np.zeros(0), np.zeros((0, nm.size)), nm, np.zeros(0), ())


def _line(why, names):
    return f"no stray light from {listed(names, MOST_NAMED)}: {why}"
