"""Bodies and volumes: depths of a scene that must not contain a border between slabs.

A border through a closed body would show its dark inside in the farther slab; a border through a volume would leave out
everything that the light meets in front of it. Holdouts cut a hole into everything behind them. Everything behind a
coloured volume or coloured transparency stays in the same slab, including the world: slabs are composited by alpha, a
single number per pixel, which would turn the tint grey.
"""

import numpy as np

from .camera import in_view, to_camera_mm
from .instances import nodes_within, rendered_instances, uses_nodes
from .render_state import rendered_layer, rendered_world
from .volumes import has_volume

EVERYWHERE_MM = 0.0, np.inf


def uncut_depths_mm(scene, lens, capture, tinting):
    """Depths of the volumes and of the closed bodies in a capture's view, as its camera clips; a holdout counts as a
    volume that is everywhere.

    A body around the camera, such as a room, is left out: its inside is visible.

    Parameters
    ----------
    scene : bpy.types.Scene
        Evaluated at the frame, with the camera that renders it.
    lens : Lens
    capture : PixelGrid
    tinting : collection of str
        Names of the objects that tint light passing straight through them.

    Returns
    -------
    volumes_mm, bodies_mm : list of (near_mm, far_mm)
    """
    layer, world = rendered_layer(scene), rendered_world(scene)
    volumes, bodies = ([EVERYWHERE_MM] if world and has_volume(world) else []), set()
    to_camera = to_camera_mm(scene)
    closed, foggy, holes = {}, {}, {}  # by data and by material: there may be many instances of few
    for instance in rendered_instances(scene):
        if instance.obj.type == "LIGHT" or not in_view(scene.camera, instance.box, lens, capture):
            continue
        near_mm, far_mm = depths_mm(instance.box, to_camera, capture.projection)
        for material in instance.materials - foggy.keys():
            foggy[material], holes[material] = has_volume(material), _has_holdout(material)
        if _is_holdout(instance.obj, layer) or any(holes[material] for material in instance.materials):
            volumes.append(EVERYWHERE_MM)
        elif instance.obj.name in tinting:
            volumes.append((max(near_mm, 0.0), np.inf))
        elif instance.obj.type == "VOLUME" or any(foggy[material] for material in instance.materials):
            volumes.append((max(near_mm, 0.0), far_mm))
        elif near_mm > 0:
            if instance.data not in closed:
                closed[instance.data] = is_closed(instance.data)
            if closed[instance.data]:
                bodies.add((near_mm, far_mm))
    return volumes, sorted(bodies)


def depths_mm(box, to_camera_mm, projection):
    """Nearest and farthest depth of a box (distance for a panorama), in mm; the nearest is 0 or less around the camera.
    """
    places_mm = box @ to_camera_mm[:3, :3].T + to_camera_mm[:3, 3]
    if projection.is_plane:
        return float(-places_mm[:, 2].max()), float(-places_mm[:, 2].min())
    low, high = places_mm.min(axis=0), places_mm.max(axis=0)
    return (float(np.linalg.norm(np.maximum(0, np.maximum(low, -high)))),
            float(np.linalg.norm(places_mm, axis=1).max()))


def is_closed(data):
    """Whether this is a mesh with two faces at each edge."""
    loops = getattr(data, "loops", ())
    if not len(loops):
        return False
    edges = np.empty(len(loops), np.int32)
    loops.foreach_get("edge_index", edges)
    return bool(np.all(np.bincount(edges, minlength=len(data.edges)) == 2))


def _has_holdout(material):
    return uses_nodes(material) and any(
        node.bl_idname == "ShaderNodeHoldout" for node in nodes_within(material.node_tree))


def _is_holdout(obj, layer):
    return obj.is_holdout or (obj.name in layer.objects and obj.holdout_get(view_layer=layer))
