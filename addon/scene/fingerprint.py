"""The fingerprint of a scene: it changes with everything that the scene's render depends on.

It covers settings, not evaluated data. Animated properties count by their curves and drivers, so all frames of a scene
have one fingerprint. Files that data-blocks read, such as images and volumes, count by their contents, and painted or
packed images by their pixels. It leaves out selection, the layout of editors and nodes, compositing, the lens, the
output, and the weights of vertex groups.
"""

import os
from functools import lru_cache
from hashlib import blake2b
from hashlib import file_digest as file_hash

import bpy
import numpy as np

from lensfield.engine.runtime.files import stamp_of

from .units import metres_per_unit

LEFT_OUT = {"rna_type", "name_full", "is_active", "is_runtime_data", "location_absolute", "dimensions", "users",
            "use_fake_user", "use_extra_user", "tag", "preview", "asset_data", "library", "library_weak_reference",
            "override_library", "original", "matrix_world", "matrix_local", "matrix_basis",
            "matrix_parent_inverse_world", "matrix", "hide_viewport", "hide_select", "hide", "pixels", "is_dirty",
            "users_collection", "grease_pencil", "texture_mesh", "cached_location", "frame_current", "session_uid"}
LEFT_OUT_STARTS = ("show_", "select", "active", "display_", "bl_", "preview_", "debug_", "bone_color", "lock_",
                   "open_")
SHOWN_IN_RENDERS = {"show_render", "show_instancer_for_render"}
LEFT_OUT_OF = {  # by type: properties that affect only editors, or are covered elsewhere
    "Camera": {"lensfield"},  # the lens and the body
    "Node": {"location", "width", "height", "label", "color", "use_custom_color", "parent", "warning_propagation"},
    "Image": {"file_format", "resolution"},  # reading these opens its file
    "NodeSocket": {"enabled", "links", "hide_value", "link_limit", "description", "pin_gizmo"},  # set by the node
    "Object": {"display", "lineart", "animation_visualization", "motion_path", "empty_display_type",
               "empty_display_size", "empty_image_depth", "empty_image_side"},
    "Mesh": {"vertices", "edges", "loops", "polygons", "loop_triangles", "uv_layers", "color_attributes",  # attributes
             "skin_vertices", "vertex_normals", "polygon_normals", "corner_normals", "loop_triangle_polygons",
             "uv_layer_clone", "uv_layer_stencil", "vertex_colors", "sculpt_vertex_colors"}}
EDITORS_ATTRIBUTES = ".select", ".uv_select", ".hide"
OURS = "cycles", "lensfield"  # only these add-ons' properties count; another machine may lack the others
RENDER = ("resolution_x", "resolution_y", "resolution_percentage", "pixel_aspect_x", "pixel_aspect_y",
          "film_transparent", "use_border", "border_min_x", "border_max_x", "border_min_y", "border_max_y",
          "use_motion_blur", "motion_blur_shutter", "motion_blur_position", "use_simplify",
          "simplify_subdivision_render", "simplify_child_particles_render")
PACKABLE = "IMAGE", "FONT", "SOUND", "VOLUME"
MOST_FILES, MOST_BYTES = 4096, 1 << 28
INPUT_FIELDS = "value", "type", "attribute_name"  # of a modifier's inputs to its nodes, since Blender 5.2
NUMBERS = {"FLOAT": np.float32, "INT": np.int32, "BOOLEAN": bool}

_fields, _known = {}, {}  # by type, and by session_uid


def scene_fingerprint(scene):
    """Text that changes as soon as anything changes that the scene's render depends on.

    It starts with Blender's version; fingerprints from two versions cannot be compared. Data-blocks that are known, and
    that no `forget` has dropped since, are not read again.
    """
    blocks = blocks_of(scene)
    digests = [f"{block.id_type} {block.name_full} {block_digest(block)}" for block in blocks]
    text = "\n".join([*sorted(digests), *sorted(_file_digests(blocks)), settings_digest(scene)])
    return "{}.{} ".format(*bpy.app.version) + blake2b(text.encode(), digest_size=12).hexdigest()


def comparable(fingerprint):
    """Whether a fingerprint is of this version of Blender."""
    return fingerprint.startswith("{}.{} ".format(*bpy.app.version))


def settings_digest(scene):
    """The digest of the scene's own settings: text."""
    walk = _Walk(_animated(scene))
    for name in RENDER:
        walk.add(name, getattr(scene.render, name))
    walk.add("metres per unit", metres_per_unit(scene))
    walk.add("camera", [(marker.frame, marker.camera) for marker in scene.timeline_markers if marker.camera]
             or scene.camera)
    walk.add("world", scene.world)
    walk.struct(scene.cycles, "cycles", scene)
    for layer in scene.view_layers:
        walk.add(layer.name, (layer.use, layer.samples))
        walk.add("material", layer.material_override)
        walk.add("layers", [(each.name, each.exclude, each.holdout, each.indirect_only)
                            for each in _layer_collections(layer.layer_collection)])
    return walk.digest()


def all_settings_digest(scene):
    """As `settings_digest`, but of all render settings, and with hair and custom properties."""
    walk = _Walk()
    for name, kind in _fields_of(scene.render):
        if kind in ("SCALAR", "ARRAY"):
            value = getattr(scene.render, name)
            walk.add(name, flat(value) if kind == "ARRAY" else value)
    walk.struct(scene.cycles_curves, "cycles_curves", scene)
    for owner in (scene, *scene.view_layers):
        walk.custom_properties(owner, "")
    return settings_digest(scene) + walk.digest()


def _layer_collections(layer_collection):
    yield layer_collection
    for child in layer_collection.children:
        yield from _layer_collections(child)


def block_digest(block):
    """The digest of a data-block: text; cached."""
    if block.session_uid not in _known:
        _known[block.session_uid] = _digest(block)
    return _known[block.session_uid]


def is_known(block):
    """Whether a data-block's digest is cached."""
    return block.session_uid in _known


def changed(block):
    """Whether a known data-block has changed; computes its digest again."""
    before = _known.pop(block.session_uid, None)
    return before is not None and block_digest(block) != before


def forget(block):
    """Drop a data-block's digest: the next fingerprint reads it again."""
    _known.pop(block.session_uid, None)


def forget_all():
    """Drop all digests."""
    _known.clear()


def forget_unannounced():
    """Drop the digests of data that scripts can write in bulk, which Blender does not announce."""
    for blocks in (bpy.data.meshes, bpy.data.curves, bpy.data.hair_curves, bpy.data.pointclouds, bpy.data.images):
        for block in blocks:
            forget(block)


def values_and_digest(block):
    """The values that count in a data-block and in its nodes, as a dict by path; and its digest, computed again.

    Arrays are flat lists, with None for animated elements. Values that keyframes or drivers set are left out, as are
    custom properties and elements that only the digest covers.
    """
    if _is_edited(block):
        return {}, _digest(block)
    walk = _walked(block)
    return walk.values, walk.digest()


def digest_without(block, names):
    """The digest of a data-block without some of its own properties, computed again."""
    walk = _Walk(_animated(block), names)
    walk.struct(block, "", block)
    return walk.digest()


def blocks_of(scene):
    """Data-blocks that a scene's objects, collections and world use, directly or not."""
    uses = {}
    for block, users in bpy.data.user_map().items():
        for user in users:
            uses.setdefault(user, []).append(block)
    waiting = [*scene.objects, *scene.collection.children_recursive,
               *filter(None, (scene.world, *(layer.material_override for layer in scene.view_layers)))]
    blocks = set(waiting)
    while waiting:
        for block in uses.get(waiting.pop(), ()):
            if block not in blocks and block.id_type not in ("SCENE", "TEXT", "LIBRARY"):
                blocks.add(block)
                waiting.append(block)
    return blocks


def _digest(block):
    if _is_edited(block):
        return f"in edit mode {id(object())}"  # until that ends, its data are elsewhere
    return _walked(block).digest()


def _is_edited(block):
    return getattr(block, "is_editmode", False)


def _walked(block):
    walk = _Walk(_animated(block))
    walk.struct(block, "", block)
    if block.id_type == "IMAGE":
        for name, data in _held_pixels(block):
            walk.add(name, blake2b(data).hexdigest())
    return walk


def _held_pixels(image):
    """(name, bytes) of the pixels inside an image: painted ones, else its packed files."""
    if image.is_dirty and image.type not in ("RENDER_RESULT", "COMPOSITING"):
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        yield "pixels", pixels
    else:
        yield from (("packed", each.packed_file.data) for each in image.packed_files)


def _file_digests(blocks):
    """A line of text for each external file that data-blocks read."""
    outside = {block for block in blocks if not (block.id_type in PACKABLE and (
        getattr(block, "packed_file", None) or getattr(block, "is_dirty", False)))}
    for block, paths in bpy.data.file_path_map(subset=outside).items() if outside else ():
        for path in paths:
            file = bpy.path.abspath(path, library=block.library)
            yield f"{block.id_type} {block.name_full} {file_digest(file, stamp_of(file)) if _is_local(file) else ''}"


def _is_local(path):
    """Whether a path, as written, does not name another machine."""
    return not path.replace("\\", "/").startswith("//")


@lru_cache(maxsize=MOST_FILES)
def file_digest(path, stamp):
    """The digest of a file's contents, cached while its stamp is the same: text; "" unless it is a regular file. Large
    files, such as films and simulations, count by size and time."""
    if not os.path.isfile(path):
        return ""
    if os.path.getsize(path) > MOST_BYTES:
        return repr(stamp)
    try:
        with open(path, "rb") as file:
            return file_hash(file, "blake2b").hexdigest()
    except OSError:
        return "not readable"


def _animated(block):
    """(path, index) of values that keyframes and drivers set: they differ at each frame: not set by the user."""
    animation = getattr(block, "animation_data", None)
    if animation is None:
        return frozenset()
    actions = {animation.action, *(strip.action for track in animation.nla_tracks for strip in track.strips)} - {None}
    curves = [*animation.drivers, *(curve for action in actions for curve in action_curves(action))]
    return frozenset((curve.data_path, curve.array_index) for curve in curves)


def action_curves(action):
    """The F-curves of an action, in any version."""
    if hasattr(action, "fcurves"):
        return list(action.fcurves)
    return [curve for layer in action.layers for strip in layer.strips for bag in strip.channelbags
            for curve in bag.fcurves]


class _Walk:
    """A digest of a struct, and of all structs that it owns.

    Attributes
    ----------
    values : dict
        The values of their properties by path, with None for animated elements of arrays.
    """

    def __init__(self, animated=frozenset(), left_out=frozenset()):
        self.values = {}
        self._parts, self._animated, self._left_out, self._visited = [], animated, left_out, set()

    def digest(self):
        return blake2b(";".join(self._parts).encode(errors="surrogateescape"), digest_size=12).hexdigest()

    def add(self, name, value):
        if isinstance(value, bpy.types.ID):
            value = value.name_full
        if isinstance(value, set):  # of flags, in an order that differs between processes
            value = sorted(value)
        self._parts.append(f"{name}={value!r}")

    def struct(self, struct, path, block):
        """Add a struct at a path in a data-block."""
        key = struct.as_pointer(), struct.rna_type.identifier
        if key in self._visited:
            return
        self._visited.add(key)
        self._parts.append(key[1])
        for name, kind in _fields_of(struct):
            inner = f"{path}.{name}" if path else name
            if inner in self._left_out:
                continue
            value = _value(struct, name)
            if kind == "POINTER":
                self._pointer(name, value, inner, block)
            elif value is None:
                self.add(name, None)
            elif kind == "COLLECTION":
                self._collection(name, value, inner, block)
            elif kind == "ARRAY":
                numbers = [None if (inner, i) in self._animated else n for i, n in enumerate(flat(value))]
                self.values[inner] = numbers
                self.add(name, [n for n in numbers if n is not None])
            elif (inner, 0) not in self._animated:
                self.values[inner] = value
                self.add(name, value)
        if isinstance(struct, bpy.types.NodesModifier) and hasattr(struct, "properties"):  # since Blender 5.2
            self._inputs(struct.properties.inputs, f"{path}.properties.inputs")
        elif isinstance(struct, bpy.types.ID | bpy.types.NodesModifier):
            self.custom_properties(struct, path)

    def _pointer(self, name, value, path, block):
        if value is None or (isinstance(value, bpy.types.ID) and not value.is_embedded_data):
            self.add(name, value)
        elif getattr(value, "type", "") == "NONE":  # a force field that is off
            self.add(name, "NONE")
        elif isinstance(value, bpy.types.ID):
            walk = _walked(value)
            self.values |= {f"{path}.{inner}": each for inner, each in walk.values.items()}
            self.add(name, walk.digest())
        elif value.id_data == block:
            self.struct(value, path, block)
            self.add(name, getattr(value, "identifier", getattr(value, "name", "")))
        else:
            self.add(name, getattr(value, "name", ""))

    def _collection(self, name, items, path, block):
        if name == "attributes":
            items = [item for item in items if not item.name.startswith(EDITORS_ATTRIBUTES)]
        self.add(name, len(items))
        if not len(items):
            return
        if items[0] is not None and _is_numbers(items[0]):
            self._numbers(items)
            return
        for index, item in enumerate(items):
            by_name = getattr(item, "name", "") and not isinstance(item, bpy.types.NodeSocket)
            key = f'"{bpy.utils.escape_identifier(item.name)}"' if by_name else index
            self._pointer(name, item, f"{path}[{key}]", block)

    def _numbers(self, items):
        """Add many structs that contain only numbers, such as edges and keys."""
        for name, kind in _fields_of(items[0]):
            prop = items[0].bl_rna.properties[name]
            if prop.type not in NUMBERS or prop.is_readonly:
                if kind == "SCALAR" and not prop.is_readonly:
                    self.add(name, [getattr(item, name) for item in items])
                continue
            values = np.empty(len(items) * max(1, prop.array_length), NUMBERS[prop.type])
            try:
                items.foreach_get(name, values)
            except (RuntimeError, TypeError):  # arrays of variable length, covered by other fields
                continue
            self.add(name, blake2b(values.tobytes()).hexdigest())

    def _inputs(self, inputs, path):
        """Add a modifier's inputs to its nodes."""
        for name in inputs.bl_rna.properties.keys():
            given = getattr(inputs, name)
            for field in (field for field in INPUT_FIELDS if hasattr(given, field)):
                value, inner = getattr(given, field), f"{path}.{name}.{field}"
                parts = list(value) if hasattr(value, "__len__") and not isinstance(value, str) else [value]
                for index, part in enumerate(parts):
                    if (inner, index) not in self._animated:
                        self.add(f"{name}.{field}", part)

    def custom_properties(self, struct, path):
        """Add the custom properties of a struct at a path in a data-block."""
        for key in sorted(struct.keys()):
            if key not in OURS and (f'{path}["{key}"]', 0) not in self._animated:
                value = struct[key]
                self.add(key, value.to_list() if hasattr(value, "to_list") else
                         value.to_dict() if hasattr(value, "to_dict") else value)


def _value(struct, name):
    try:
        return getattr(struct, name)
    except (AttributeError, ValueError, RuntimeError):  # such as text in an unknown encoding, in old files
        return None


def flat(value):
    """The elements of an array property, row by row: list."""
    return np.array(value).ravel().tolist() if len(value) and hasattr(value[0], "__len__") else list(value)


def _is_numbers(item):
    return not isinstance(item, bpy.types.ID) and all(kind not in ("POINTER", "COLLECTION") for _, kind in
                                                      _fields_of(item)) and "name" not in item.bl_rna.properties


def _fields_of(struct):
    """(name, kind) of the properties of a type that count."""
    kind = struct.bl_rna.identifier
    if kind not in _fields:
        _fields[kind] = list(_counting(struct))
    return _fields[kind]


def _place(prop):
    """The place of a property in its type. Add-ons' are last, by name: Blender has them by the time of their
    registration, which differs between processes."""
    return prop.is_runtime, prop.identifier if prop.is_runtime else ""


def _counting(struct):
    left_out = LEFT_OUT.union(*(names for base, names in LEFT_OUT_OF.items()
                                if isinstance(struct, getattr(bpy.types, base))))
    group = isinstance(struct, bpy.types.PropertyGroup)
    for prop in sorted(struct.bl_rna.properties, key=_place):
        name, container = prop.identifier, prop.type in ("POINTER", "COLLECTION")
        editors = name.startswith(LEFT_OUT_STARTS) and name not in SHOWN_IN_RENDERS
        if name in left_out or editors or (prop.is_readonly and not container):
            continue
        if prop.is_runtime and not group and name not in OURS:
            continue
        yield name, prop.type if container else "ARRAY" if getattr(prop, "is_array", False) else "SCALAR"
