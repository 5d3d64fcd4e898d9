"""All data that a .blend would save, as plain values for comparison."""

import bpy

SKIPPED = {"rna_type", "depsgraph", "bl_rna", "is_evaluated", "is_updated", "is_updated_data", "preview"}
NOT_SAVED = {"window_managers", "screens", "workspaces", "all_ids"}  # the last lists the contents of the others
GEOMETRY = {"vertices", "edges", "loops", "polygons", "loop_triangles", "loop_triangle_polygons", "corner_normals",
            "vertex_normals", "polygon_normals", "attributes", "uv_layers", "color_attributes", "vertex_colors"}

COMPOSITOR = ("node_groups", "('images'", "('actions'", "compositing_node_group", ".node_tree", "use_nodes",
              "compositor_key", "('scenes', 'Scene') .users")
"""Data that the compositor step may create or change; its Render Layers node is a user of the scene."""


def snapshot():
    """All data-blocks by collection and name, with their properties, nodes, links and custom properties."""
    blocks = {}
    for prop in bpy.data.bl_rna.properties:
        if prop.type == "COLLECTION" and prop.identifier not in NOT_SAVED:
            for block in getattr(bpy.data, prop.identifier):
                if block.name == "Render Result":  # any render appears there; it is not saved
                    continue
                blocks[prop.identifier, block.name_full] = _struct(block, {_identity(block)})
    return blocks


def differences(before, after):
    """Names of the differences, for a readable message."""
    changes = [f"{key} {'gone' if key in before else 'new'}" for key in before.keys() ^ after.keys()]
    for key in before.keys() & after.keys():
        changes += [f"{key} {path}: {old} -> {new}" for path, old, new in _differ(before[key], after[key], "")]
    return changes


def _differ(old, new, path):
    if isinstance(old, dict) and isinstance(new, dict):
        for name in old.keys() | new.keys():
            yield from _differ(old.get(name), new.get(name), f"{path}.{name}")
    elif old != new:
        yield path, old, new


def _struct(struct, visited):
    values = {}
    for prop in struct.bl_rna.properties:
        if prop.identifier not in SKIPPED | GEOMETRY:
            values[prop.identifier] = _value(struct, prop, visited)
    if isinstance(struct, bpy.types.ID):
        values["custom"] = {key: repr(struct[key]) for key in struct.keys()}
        values["users"] = struct.users
    return values


def _value(struct, prop, visited):
    try:
        value = getattr(struct, prop.identifier)
    except (AttributeError, RuntimeError):
        return None
    if prop.type == "COLLECTION":
        return _collection(prop, value, visited)
    if prop.type != "POINTER":
        return _copy(value)
    if value is None:
        return None
    embedded = isinstance(value, bpy.types.NodeTree) and value.name_full not in bpy.data.node_groups
    if isinstance(value, bpy.types.ID) and not embedded:
        return value.name_full
    if _identity(value) in visited:
        return "seen"
    return _struct(value, visited | {_identity(value)})


def _identity(struct):
    """A struct's first member has the struct's address, so the type is part of the key."""
    return struct.bl_rna.identifier, struct.as_pointer()


def _copy(value):
    """A copy outside Blender's memory, also of vectors and matrices."""
    if isinstance(value, (str, bytes)) or not hasattr(value, "__len__"):
        return value
    return sorted(value) if isinstance(value, set) else tuple(_copy(item) for item in value)


def _collection(prop, items, visited):
    if prop.identifier == "links":
        return sorted((link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier)
                      for link in items)
    values = {}
    for index, item in enumerate(items):
        if item is None or isinstance(item, bpy.types.ID):
            values[index] = item and item.name_full
        elif _identity(item) not in visited:
            values[index] = _struct(item, visited | {_identity(item)})
    return values
