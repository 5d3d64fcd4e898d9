"""Ground truth: what the rays through the middles of a capture's pixels meet, by Blender's passes.

Cycles averages normals, UV and motion over the samples of a pixel, which may show several surfaces, and the slabs of a
capture hide what another slab shows. So a render of its own takes the first sample, whose ray is in the pixel's middle.
It sees everything at once, traces no light further, and is as fast as one sample. Cryptomatte takes a few more.
"""

from collections import Counter
from dataclasses import replace

import numpy as np

from lensfield.engine import InputError
from lensfield.engine.depth.depth_range import planar_depth_mm
from lensfield.engine.truth.captured_truth import (
    CRYPTOMATTE,
    DEPTH,
    NORMAL,
    OBJECT,
    UV,
    VECTOR,
    CapturedTruth,
    ShownObject,
)
from lensfield.engine.truth.cryptomatte import renamed

from ..scene.camera import camera_pose
from ..scene.errors import SceneError
from ..scene.instances import SHADED_TYPES, rendered_instances
from ..scene.motion import moving
from ..scene.render_state import effective_samples, go_to_frame, rendered_layer
from ..scene.truth_outputs import INDICES
from ..scene.undo import Journal
from ..scene.units import M_TO_MM, depth_pass_m, metres_per_unit
from .coverage import MATTE_SAMPLES, WITHOUT_MATERIAL, mattes_steps
from .surface_passes import surface_planes_steps

FIRST_OBJECT = f"{CRYPTOMATTE}Object00.r"
"""The object of a pass with one sample."""
DATA = {"depth": {"z": f"{DEPTH}.Z"}, "position": {"z": f"{DEPTH}.Z"}, "normal": {"normal": f"{NORMAL}.XYZ"},
        "uv": {"uv": f"{UV}.UVA"}, "flow": {"vector": f"{VECTOR}.XYZW", "z": f"{DEPTH}.Z"},
        "index": dict(zip(("object_index", "material_index"), (f"{name}.X" for name in INDICES), strict=True)),
        "object": {"cryptomatte_object": FIRST_OBJECT}}
"""Blender's passes of one sample, and their channels, for each kind of truth."""
MATTES = {"cryptomatte": {f"cryptomatte_{kind.lower()}": f"{CRYPTOMATTE}{kind}"
                          for kind in ("Object", "Material", "Asset")}}
ID_CHANNELS = "rb"
CATEGORY = "category_id"  # BlenderProc's custom property


def check_truth(scene, job):
    """Raise an InputError for ground truth that a render cannot yield."""
    if job.truth and job.traced:
        raise InputError("options", "truth", job.truth,
                         "a traced lens does not render a capture: leave truth out, or use depth auto or off")
    frames = range(min(scene.frame_start, job.frame - 1), max(scene.frame_end, job.frame + 1) + 1)
    if "flow" in _products(job) and not moving(scene, frames):
        raise SceneError(f"scene {scene.name!r}", "motion", "none",
                         "flow would be 0 everywhere: animate an object or the camera, or leave flow out of truth")
    if "object" in _products(job):
        _objects(scene)


def _products(job):
    return tuple(job.truth.split(",")) if job.truth else ()


def truth_steps(ready, slabs, times, fraction):
    """Steps that render the ground truth of a capture; returns a CapturedTruth, or None if none is requested.

    Parameters
    ----------
    ready : Ready
    slabs : sequence of Slab
        Of the layers of its light.
    times : int
        Parts of a pixel, down and across, whose light is known.
    fraction : float
        Of the job so far.
    """
    scene, job, products = ready.scene, ready.job, _products(ready.job)
    if not products:
        return None
    planes = {}
    for kinds, samples in ((DATA, 1), (MATTES, min(MATTE_SAMPLES, effective_samples(scene)))):
        passes = {name: channels for product in products for name, channels in kinds.get(product, {}).items()}
        if passes:
            rendered = yield from surface_planes_steps(ready, ready.complete, passes, samples, fraction)
            planes |= {OBJECT if name == passes.get("cryptomatte_object") else name: plane
                       for name, plane in rendered.items()}
    grid = replace(ready.capture_px.part(ready.complete.region), focal_mm=job.lens.capture_focal_length_mm)
    if (depth := planes.get(f"{DEPTH}.Z")) is not None:
        planes[f"{DEPTH}.Z"] = _planar_m(depth, ready, grid)
    for channel in planes:
        if channel.startswith(f"{CRYPTOMATTE}Material") and channel[-1] in ID_CHANNELS:
            planes[channel] = renamed(planes[channel], ready.substitution.materials)
    names = _names(scene, ready.substitution.materials) if "cryptomatte" in products else {}
    objects = _objects(scene) if "object" in products else {}
    neighbours = _neighbours(scene, job.frame + job.subframe) if "flow" in products else None
    mattes = yield from mattes_steps(ready, slabs, times, products, fraction)
    return CapturedTruth(grid, planes, rendered_layer(scene).name, products, camera_pose(scene)[:3], neighbours, names,
                         objects, mattes)


def _neighbours(scene, frame):
    """The axes of this frame's camera at the frame before and at the next one, as Cycles takes them for motion."""
    camera, axes = scene.camera, []
    for other in (frame - 1, frame + 1):
        with Journal() as journal:
            go_to_frame(scene, other, journal)
            scene.camera = camera  # a marker may bind another one
            axes.append(camera_pose(scene)[:3, :3])
    return np.array(axes)


def _planar_m(depth, ready, grid):
    """Depths along the optical axis in metres, from a depth pass of this grid; inf for the background."""
    depth_mm = depth_pass_m(depth, metres_per_unit(ready.scene)) * M_TO_MM
    depth_m = planar_depth_mm(depth_mm, ready.job.lens, grid) / M_TO_MM
    return np.where(np.isfinite(depth_m), depth_m, np.inf).astype(np.float32)


def _names(scene, materials):
    """The names in each Cryptomatte layer; `materials` maps the names of stand-ins to the user's materials."""
    objects, assets, painted = set(), set(), {WITHOUT_MATERIAL}
    for instance in (each for each in rendered_instances(scene) if each.obj.type in SHADED_TYPES):
        objects.add(instance.obj.name)
        assets.add(_root(instance.obj).name)
        painted |= {materials.get(material.name, material.name) for material in instance.materials}
    return {f"{CRYPTOMATTE}{kind}": frozenset(names)
            for kind, names in (("Object", objects), ("Material", painted), ("Asset", assets))}


def _objects(scene):
    """The ShownObject of each name; raises a SceneError for a category that is not a number."""
    shown = Counter(each.obj for each in rendered_instances(scene) if each.obj.type in SHADED_TYPES)
    objects = {}
    for obj, instances in shown.items():
        known = objects.get(obj.name, ShownObject(0, 0))  # linked objects may share a name
        objects[obj.name] = ShownObject(_category(obj), known.instances + instances)
    return objects


def _category(obj):
    """The category of an object's annotations: its custom property, if it has one, or its pass index."""
    category = obj.get(CATEGORY, obj.pass_index)
    if not isinstance(category, int) or category < 0:
        raise SceneError(f"object {obj.name!r}", CATEGORY, category, "expected a whole number; 0 for no annotation")
    return int(category)


def _root(obj):
    """The topmost parent of an object, or the object."""
    return _root(obj.parent) if obj.parent else obj
