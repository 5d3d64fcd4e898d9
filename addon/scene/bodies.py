"""Bodies and volumes: over which depths of a scene no border between slabs may go.

A border through a closed body would show its dark inside in the farther slab; one through a volume would leave out what
the light meets before it. Holdouts make a hole in all that is behind them.
"""

import numpy as np

from ...engine.image.pixel_grid import PLANE
from .camera import in_view
from .depth import M_TO_MM
from .instances import cycles_output, nodes_within, rendered_instances, uses_nodes
from .render_state import rendered_layer

EVERYWHERE_MM = 0.0, np.inf


def whole_depths_mm(scene, lens, capture):
    """Depths of the volumes and of the closed bodies in a capture's view, as its camera clips; a holdout is as a volume
    that is everywhere.

    A body around the camera, such as a room, is left out: it is seen from its inside.

    Parameters
    ----------
    scene : bpy.types.Scene
        Evaluated at the frame, by the camera that renders it.
    lens : Lens
    capture : PixelGrid

    Returns
    -------
    volumes_mm, bodies_mm : list of (near_mm, far_mm)
    """
    layer = rendered_layer(scene)
    world = layer.world_override or scene.world
    volumes, bodies = ([EVERYWHERE_MM] if world and _has_volume(world) else []), set()
    to_camera = np.linalg.inv(np.array(scene.camera.matrix_world.normalized()))
    closed, foggy, holes = {}, {}, {}  # by data and by material: there may be many instances of few
    for instance in rendered_instances(scene):
        if instance.obj.type == "LIGHT" or not in_view(scene.camera, instance.box, lens, capture):
            continue
        near_mm, far_mm = _depths_mm(instance.box, to_camera, capture.projection)
        for material in instance.materials - foggy.keys():
            foggy[material], holes[material] = _has_volume(material), _has_holdout(material)
        if _is_holdout(instance.obj, layer) or any(holes[material] for material in instance.materials):
            volumes.append(EVERYWHERE_MM)
        elif instance.obj.type == "VOLUME" or any(foggy[material] for material in instance.materials):
            volumes.append((max(near_mm, 0.0), far_mm))
        elif near_mm > 0:
            if instance.data not in closed:
                closed[instance.data] = _is_closed(instance.data)
            if closed[instance.data]:
                bodies.add((near_mm, far_mm))
    return volumes, sorted(bodies)


def _depths_mm(box, to_camera, projection):
    """Nearest and farthest that a box is, in depth, or in distance for a fisheye; nearest 0 or less around the camera.
    """
    places = (box @ to_camera[:3, :3].T + to_camera[:3, 3]) * M_TO_MM
    if projection == PLANE:
        return float(-places[:, 2].max()), float(-places[:, 2].min())
    low, high = places.min(axis=0), places.max(axis=0)
    return (float(np.linalg.norm(np.maximum(0, np.maximum(low, -high)))),
            float(np.linalg.norm(places, axis=1).max()))


def _is_closed(data):
    """Whether this is a mesh of which each edge has two faces."""
    loops = getattr(data, "loops", ())
    if not len(loops):
        return False
    edges = np.empty(len(loops), np.int32)
    loops.foreach_get("edge_index", edges)
    return bool(np.all(np.bincount(edges, minlength=len(data.edges)) == 2))


def _has_volume(block):
    """Whether Cycles renders a volume for this material or world."""
    output = cycles_output(block)
    return bool(output and output.inputs["Volume"].is_linked)


def _has_holdout(material):
    return uses_nodes(material) and any(
        node.bl_idname == "ShaderNodeHoldout" for node in nodes_within(material.node_tree))


def _is_holdout(obj, layer):
    return obj.is_holdout or (obj.name in layer.objects and obj.holdout_get(view_layer=layer))
