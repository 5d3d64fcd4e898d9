"""The rendered objects with all their instances, and the materials, lights and worlds in use.

Outside a render, Blender evaluates a scene only for the viewport. So evaluated objects are filtered by their render
flags, and objects that are hidden only in the viewport are added by hand.
"""

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

SHADED_TYPES = {"MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD", "VOLUME"}
DRAWN_TYPES = {"GREASEPENCIL", "GPENCIL"}  # drawn over the picture, not by the renderer; the second until 4.2


@dataclass(frozen=True, eq=False)
class Instance:
    """One appearance of an object in the render.

    Attributes
    ----------
    obj : bpy.types.Object
        The original.
    matrix_world : array (4, 4)
        An object that is hidden in the viewport follows only its parents: Blender does not evaluate its constraints.
    corners : array (8, 3)
        Of its bounding box, in its own frame.
    materials : frozenset of bpy.types.Material
    data : bpy.types.ID or None
        Its evaluated shape.
    """

    obj: bpy.types.Object
    matrix_world: np.ndarray
    corners: np.ndarray
    materials: frozenset
    data: bpy.types.ID | None

    @property
    def box(self):
        """Corners of its bounding box in the world, in metres: array (8, 3)."""
        return self.corners @ self.matrix_world[:3, :3].T + self.matrix_world[:3, 3]


def rendered_instances(scene):
    """Generator of the Instances in a render of the scene.

    It uses Blender's evaluated scene: change nothing before it ends.
    """
    for appearance, matrix, corners, materials in _rendered(scene):
        yield Instance(appearance.original, np.array(matrix), corners, materials, appearance.data)


def rendered_blocks(scene):
    """The materials, lights, worlds and Grease Pencil drawings in a render of the scene.

    Returns
    -------
    dict from data-block to the sorted names of the objects that use it; empty for a world
    """
    users = {layer.world_override or scene.world: set() for layer in scene.view_layers if layer.use}
    users.pop(None, None)
    for appearance, _, _, materials in _rendered(scene):
        obj = appearance.original
        obj_data = {obj.data} if obj.type in {"LIGHT", *DRAWN_TYPES} else ()
        for block in (*materials, *obj_data):
            users.setdefault(block, set()).add(obj.name)
    return {block: tuple(sorted(names)) for block, names in users.items()}


def uses_nodes(block):
    """Whether Blender renders a material, light or world by its node tree instead of its plain colour."""
    if block.node_tree is None:
        return False
    always = bpy.app.version >= (5, 0, 0) and not isinstance(block, bpy.types.Light)
    return always or block.use_nodes


def cycles_output(block):
    """The output node that Cycles uses for a material, light or world; None without one."""
    return block.node_tree.get_output_node("CYCLES") if uses_nodes(block) else None


def nodes_within(tree):
    """Generator of the nodes of a tree, and of the groups within it."""
    for node in tree.nodes:
        yield node
        inside = getattr(node, "node_tree", None)
        if inside:
            yield from nodes_within(inside)


def materials_of(obj):
    """Materials of an object, evaluated or not: the ones that a mesh's faces use, and all slots of other shapes."""
    slots = [slot.material and slot.material.original for slot in obj.material_slots]
    if obj.type == "MESH" and len(slots) > 1 and not obj.particle_systems:  # hair has a slot of its own
        slots = [slots[index] for index in _slots_used(obj.data, len(slots))]
    return frozenset(slots) - {None}


def _slots_used(mesh, count):
    indices = mesh.attributes.get("material_index")
    if indices is None:
        return [0]
    of_faces = np.zeros(len(mesh.polygons), dtype=np.int32)
    mesh.polygons.foreach_get("material_index", of_faces)
    return np.unique(np.clip(of_faces, 0, count - 1))


def _shown_materials(appearance, layer):
    """The materials of an object in the render."""
    if appearance.type not in SHADED_TYPES:
        return frozenset()
    if layer.material_override:
        return frozenset({layer.material_override})
    materials = materials_of(appearance)
    if appearance.is_evaluated and _shown_as_rendered(appearance):
        return materials
    return materials | frozenset(_by_nodes(appearance, "MATERIAL"))


def _rendered(scene):
    """(object, matrix, corners, materials) of all rendered objects and instances."""
    for layer in (layer for layer in scene.view_layers if layer.use):
        known = {}  # a forest has few trees
        for appearance, matrix in _appearances(layer):
            key = appearance.original, appearance.data
            if key not in known:
                known[key] = np.array(appearance.bound_box), _shown_materials(appearance, layer)
            yield appearance, matrix, *known[key]


def _appearances(layer):
    """(object, matrix) of all objects that a layer renders, with instances; evaluated if Blender has evaluated them."""
    layer.update()  # until then a new layer has no collections (since 5.2)
    shown = {obj for obj in _shown_objects(layer.layer_collection) if not obj.hide_render}
    evaluated, instanced, of_collections = set(), set(), {}
    for instance in layer.depsgraph.object_instances:
        if instance.is_instance:
            source = instance.parent.original
            instanced.add(instance.object.original)
            if source.instance_type == "COLLECTION" and source not in of_collections:
                of_collections[source] = {child for child, _ in _instanced(source, _world_matrix(source), {source})}
            renders = source in shown and instance.object.original in of_collections.get(source, instanced)
        else:
            source = instance.object.original
            evaluated.add(source)
            renders = source in shown and (source.show_instancer_for_render or not source.is_instancer)
        if renders:
            yield instance.object, instance.matrix_world
    for obj in shown:
        if obj not in evaluated:
            yield obj, _world_matrix(obj)
        for child, matrix in _instanced(obj, _world_matrix(obj), {obj}):
            if obj not in evaluated or child not in instanced:
                yield child, matrix


def _shown_objects(layer_collection):
    """Objects of the collections that a layer renders. Nested collections inherit hiding, but not exclusion."""
    if layer_collection.collection.hide_render:
        return
    if not layer_collection.exclude:
        yield from layer_collection.collection.objects
    for child in layer_collection.children:
        yield from _shown_objects(child)


def _shown_as_rendered(obj):
    """Whether the viewport evaluates all modifiers of a render."""
    return all(modifier.show_viewport or not modifier.show_render for modifier in obj.modifiers)


def _instanced(obj, matrix, above):
    """(object, matrix) of all objects that an object may instance; scattered ones get its own position."""
    for child, placed in _instanced_once(obj, matrix):
        if child not in above:
            yield child, placed
            yield from _instanced(child, placed, above | {child})


def _instanced_once(obj, matrix):
    if obj.instance_type == "COLLECTION" and obj.instance_collection:
        to_origin = matrix @ Matrix.Translation(-obj.instance_collection.instance_offset)
        for child in _collection_objects(obj.instance_collection):
            yield child, to_origin @ _world_matrix(child)
    for settings in (system.settings for system in obj.particle_systems):
        if settings.render_type == "OBJECT" and settings.instance_object:
            yield settings.instance_object, matrix
        elif settings.render_type == "COLLECTION" and settings.instance_collection:
            yield from ((child, matrix) for child in _collection_objects(settings.instance_collection))
    yield from ((child, matrix) for child in _by_nodes(obj, "OBJECT"))
    for collection in _by_nodes(obj, "COLLECTION"):
        yield from ((child, matrix) for child in _collection_objects(collection))


def _collection_objects(collection):
    """Objects that an instance of a collection renders."""
    if not collection.hide_render:
        yield from (obj for obj in collection.objects if not obj.hide_render)
        for child in collection.children:
            yield from _collection_objects(child)


def _by_nodes(obj, socket_type):
    """Data-blocks of this type of socket that an object's geometry nodes may bring in."""
    for modifier in obj.modifiers:
        if modifier.type == "NODES" and modifier.show_render and modifier.node_group:
            given = (_given(modifier, item.identifier) for item in modifier.node_group.interface.items_tree
                     if item.item_type == "SOCKET" and item.socket_type == f"NodeSocket{socket_type.capitalize()}")
            yield from filter(None, given)
            yield from _named_in_tree(modifier.node_group, socket_type)


def _given(modifier, identifier):
    """A modifier's value for an input of its nodes. Blender 5.2 moved it."""
    if not hasattr(modifier, "properties"):
        return modifier.get(identifier)
    return getattr(getattr(modifier.properties.inputs, identifier, None), "value", None)


def _named_in_tree(tree, socket_type):
    for node in nodes_within(tree):
        yield from (socket.default_value for socket in node.inputs
                    if socket.type == socket_type and socket.default_value)


def _world_matrix(obj):
    """The world matrix of an object, evaluated or not."""
    basis = obj.matrix_basis
    return _world_matrix(obj.parent) @ obj.matrix_parent_inverse @ basis if obj.parent else basis
