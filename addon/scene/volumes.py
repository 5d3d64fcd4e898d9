"""Volumes, and scenes without them.

Cycles finds a pixel's depth with the ray of its first sample, which records none if a volume scatters it first: in thin
fog, a fifth of the surfaces' pixels seem to be at infinity.
"""

import bpy

from .instances import cycles_output, rendered_instances
from .render_state import rendered_world


def has_volume(block):
    """Whether Cycles renders a volume for this material or world."""
    return _is_linked(block, "Volume")


def hide_volumes(scene, journal):
    """Let the camera see through all volumes, though not through their surfaces.

    Returns
    -------
    bool
        Whether there are any.
    """
    world = rendered_world(scene)
    if not (bpy.data.volumes or any(map(has_volume, bpy.data.materials)) or world and has_volume(world)):
        return False  # without a look at all instances, which may be many
    linked, gas = {}, set()
    for instance in rendered_instances(scene):
        for material in instance.materials - linked.keys():
            linked[material] = has_volume(material), _is_linked(material, "Surface")
        volumes, surfaces = (any(linked[material][n] for material in instance.materials) for n in (0, 1))
        if instance.obj.type == "VOLUME" or volumes and not surfaces:
            gas.add(instance.obj)
    foggy = {material for material, of_both in linked.items() if all(of_both)}
    foggy |= {world} if world and has_volume(world) else set()
    for obj in gas:  # a material without a volume and a surface would be black
        journal.set(obj, "visible_camera", False)
    for block in foggy:
        journal.on_exit(block.update_tag)  # Cycles keeps a shader, with persistent data, if only a link changes
        for link in cycles_output(block).inputs["Volume"].links:
            journal.set(link, "is_muted", True)
        block.update_tag()
    return bool(gas or foggy)


def _is_linked(block, socket):
    output = cycles_output(block)
    return bool(output and output.inputs[socket].is_linked)
