"""Mattes for coverage: what the surfaces in each slab of a capture belong to, by Cryptomatte.

Light and mattes have the same slabs and motion blur. So mattes include surfaces that nearer ones hide from the
pinhole, but not from the rim of the lens.
"""

from dataclasses import replace

import numpy as np

from lensfield.engine.truth.captured_truth import CRYPTOMATTE
from lensfield.engine.truth.cryptomatte import id_of
from lensfield.engine.truth.mattes import Mattes, shares_of_surfaces

from ..scene.instances import SHADED_TYPES, rendered_instances
from ..scene.render_state import effective_samples
from ..scene.units import metres_per_unit
from .slabs import BEYOND_ALL_UNITS
from .surface_passes import surface_planes_steps

KINDS = {"coverage": "Object", "material-coverage": "Material", "collection-coverage": "Object"}
"""Kinds of truth, and the Cryptomatte layers that they are made from."""
MATTE_SAMPLES = 16
WITHOUT_MATERIAL = "default_surface"  # Cycles' name of the material of objects without one


def mattes_steps(ready, slabs, times, products, fraction):
    """Steps that render what the surfaces of a capture belong to; returns a dict of str: Mattes, by kinds of truth.

    Parameters
    ----------
    ready : Ready
    slabs : sequence of Slab
        Of the layers of its light.
    times : int
        Parts of a pixel, down and across, whose light is known.
    products : collection of str
        The requested kinds of truth.
    fraction : float
        Of the job so far.
    """
    chosen = [product for product in KINDS if product in products]
    if not chosen:
        return {}
    kinds = {KINDS[product] for product in chosen}
    layers = []
    for slab in slabs:
        layers.append((yield from _slab_steps(ready, slab, times, kinds, fraction)))
    result = {}
    for product in chosen:
        owners, members = _OWNERS[product](ready)
        owner_of = {int(id_of(name).view(np.uint32)): owner for name, owner in owners.items()}
        result[product] = Mattes.of([of_kinds[KINDS[product]] for of_kinds in layers], owner_of, members)
    return result


def _slab_steps(ready, slab, times, kinds, fraction):
    """Steps that render what a slab's surfaces are; returns the `shares_of_surfaces` of its pixels, by kind."""
    if slab.near_m >= BEYOND_ALL_UNITS[0] * metres_per_unit(ready.scene):  # the world
        nothing = np.zeros([times * (side.stop - side.start) for side in slab.region], np.float32)
        no_ids = nothing[None].view(np.uint32)
        return dict.fromkeys(kinds, shares_of_surfaces(no_ids, nothing[None], nothing, True, times))
    passes = {f"cryptomatte_{kind.lower()}": f"{CRYPTOMATTE}{kind}" for kind in kinds}
    samples = max(min(MATTE_SAMPLES, effective_samples(ready.scene)) // times**2, 1)
    planes = yield from surface_planes_steps(ready, replace(slab, transparent=True),
                                             passes | {"combined": "Combined.A"}, samples, fraction, times=times,
                                             motion_blur=True)
    if not ready.cut:  # a flat capture also has the pixels beyond a render region
        margins = [(times * side.start, times * (n - side.stop))
                   for side, n in zip(slab.region, ready.grid.shape_px, strict=True)]
        planes = {name: np.pad(plane, margins) for name, plane in planes.items()}
    opaque = not (ready.cut and slab.transparent)
    return {kind: shares_of_surfaces(_matte(planes, kind, "br").view(np.uint32), _matte(planes, kind, "ag"),
                                     planes["Combined.A"], opaque, times) for kind in kinds}


def _matte(planes, kind, channels):
    """Some channels of a Cryptomatte layer: array (rank, row, column)."""
    names = sorted(name for name in planes if name.startswith(f"{CRYPTOMATTE}{kind}"))
    return np.array([planes[name] for name in names if name[-1] in channels])


def _objects(ready):
    return {obj.name: obj.name for obj in _shown(ready.scene)}, {}


def _materials(ready):
    users, owners = ready.substitution.materials, {WITHOUT_MATERIAL: WITHOUT_MATERIAL}
    for instance in rendered_instances(ready.scene):
        owners |= {material.name: users.get(material.name, material.name) for material in instance.materials}
    return owners, {}


def _collections(ready):
    """An object's owner is the first collection in the Outliner that contains it directly. The mask of a collection
    includes the collections in it, except for Scene Collection, and unless an earlier one contains them, too: all masks
    at the top level add up to all surfaces. Names of linked collections include their file, because they may repeat.
    """
    root, home, members = ready.scene.collection, {}, {}

    def visit(collection, above):
        if collection.name_full not in members:
            for name in (*above, collection.name_full):
                members.setdefault(name, []).append(collection.name_full)
            for obj in collection.objects:
                home.setdefault(obj.name, collection.name_full)
            for child in collection.children:
                visit(child, (*above, collection.name_full) if collection != root else ())

    visit(root, ())
    for obj in sorted(_shown(ready.scene), key=lambda obj: obj.name_full):  # instances show objects outside the scene
        others = [collection.name_full for collection in obj.users_collection] or [root.name_full]
        owner = home.setdefault(obj.name, others[0])
        members.setdefault(owner, [owner])
    return home, members


def _shown(scene):
    """The rendered objects with surfaces: set."""
    return {instance.obj for instance in rendered_instances(scene) if instance.obj.type in SHADED_TYPES}


_OWNERS = {"coverage": _objects, "material-coverage": _materials, "collection-coverage": _collections}
"""Functions of a Ready: the owner of each name in Cryptomatte, and the owners in each mask."""
