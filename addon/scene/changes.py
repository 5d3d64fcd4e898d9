"""Changed values of properties, sent to a process that has loaded a copy of the file, instead of a new copy.

Blender announces which data-blocks have changed (`changed_blocks`). If nothing but their values has changed since the
copy was saved (`structure_digest`), these are written to a file (`write_changes`). The other process sets the values
that differ, and compares digests (`take_changes`). Otherwise the file must be copied again: if a mesh or an image was
edited; if a data-block, a modifier or a link was added or removed; if a setting of the scene was changed; and if the
scene has simulations, whose caches only a copy contains.
"""

import json
from contextlib import suppress
from pathlib import Path

import numpy as np

from lensfield.engine import Options
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.files import atomic_path

from .fingerprint import all_settings_digest, blocks_of, flat, values_and_digest
from .motion import has_simulations

VALUED = {"OBJECT", "CAMERA", "LIGHT", "WORLD", "MATERIAL", "NODETREE", "COLLECTION"}
SHAPES = {"MESH", "CURVE", "CURVES", "META", "POINTCLOUD", "VOLUME"}
OF_WINDOW = {"SCENE", "WINDOWMANAGER", "SCREEN", "WORKSPACE", "BRUSH"}  # covered by `structure_digest`, or not rendered
WITH_OWN_DATA = {"CAMERA", "LIGHT", "LIGHT_PROBE"}  # types of objects whose data-block is announced for its changes
MOST_BLOCKS = 1000  # reading one takes about a millisecond
ROUNDS = 2  # setting a property can change those before it
MAYBE, DIFFERENT, COPY = range(3)


def changed_blocks(depsgraph, before):
    """The data-blocks that have changed, added to those that changed before: dict by ID type and full name.

    DIFFERENT if only their own values can explain the change, MAYBE if other data-blocks can, COPY if values cannot
    express it.
    """
    now = {name_of(update.id.original): _expected(update) for update in depsgraph.updates
           if update.id.id_type not in OF_WINDOW and not update.id.original.is_embedded_data  # its owner is announced
           and not _is_shading_of_shape(update)}
    return before | {name: max(each, before.get(name, MAYBE)) for name, each in now.items()}


def _expected(update):
    kind = update.id.id_type
    if kind not in VALUED:
        return COPY
    if kind == "OBJECT":
        return DIFFERENT if update.is_updated_geometry and update.id.type not in WITH_OWN_DATA else MAYBE
    if kind == "CAMERA":  # else only its focus, its f-stop or Lensfield's settings may have changed
        return DIFFERENT if update.is_updated_shading else MAYBE
    return DIFFERENT if _flags(update) != (False, False, False) and kind != "COLLECTION" else MAYBE


def _is_shading_of_shape(update):
    """Whether an update of a mesh, a curve or the like is only due to its materials, which its objects list, too."""
    return update.id.id_type in SHAPES and _flags(update) == (False, False, True)


def _flags(update):
    return update.is_updated_transform, update.is_updated_geometry, update.is_updated_shading


def name_of(block):
    """The ID type and the full name of a data-block."""
    return block.id_type, block.name_full


def render_switches(scene):
    """Whether the modifiers of a scene's objects are on in renders, which Blender does not announce: dict of lists."""
    return {name_of(obj): [modifier.show_render for modifier in obj.modifiers]
            for obj in scene.objects if obj.modifiers}


def structure_digest(scene):
    """Text that changes with everything about a scene that the values of its data-blocks cannot express."""
    names = sorted(map(name_of, blocks_of(scene)))
    request = scene.lensfield.without_camera(options=Options())
    return json.dumps([names, repr(request), all_settings_digest(scene)])


def write_changes(path, scene, changed, expected):
    """Write the values of changed data-blocks, and the current frame.

    Parameters
    ----------
    path : path
        .json
    scene : bpy.types.Scene
    changed : dict
        From `changed_blocks`, since the copy was saved.
    expected : MAYBE or DIFFERENT
        Whether anything must differ.

    Returns
    -------
    bool
        False if the file must be copied instead; nothing is written then.
    """
    blocks = {name_of(block): block for block in blocks_of(scene)}
    sent = {name: MAYBE for name in blocks if name[0] == "COLLECTION"}
    sent |= {name: each for name, each in changed.items() if name in blocks}
    if COPY in sent.values() or len(sent) > MOST_BLOCKS or not values_suffice(scene, blocks.values()):
        return False
    changes = {"frame": [scene.frame_current, scene.frame_subframe], "expected": expected,
               "blocks": [[*name, each, *values_and_digest(blocks[name])] for name, each in sent.items()]}
    with atomic_path(path, overwrite=True) as temporary:
        temporary.write_text(json.dumps(changes, default=_json_value))
    return True


def values_suffice(scene, blocks):
    """Whether values can describe a scene's data-blocks: no painted images, and no simulations."""
    return not any(getattr(block, "is_dirty", False) for block in blocks) and not has_simulations(scene, blocks)


def take_changes(scene, path):
    """Apply changes from `write_changes` to a scene that was loaded from a copy.

    Parameters
    ----------
    scene : bpy.types.Scene
    path : path

    Raises
    ------
    InputError
        The scene cannot become equal by setting values. Some may have been set.
    """
    changes = read_changes(path)
    blocks = {name_of(block): block for block in blocks_of(scene)}
    differ = [_take(blocks.get((kind, name)), name, *facts) for kind, name, *facts in changes["blocks"]]
    if frame_differs := changes["frame"] != [scene.frame_current, scene.frame_subframe]:
        frame, subframe = changes["frame"]
        scene.frame_set(frame, subframe=subframe)
    if changes["expected"] == DIFFERENT and not frame_differs and not any(differ):
        raise needs_copy(path, "empty")


def read_changes(path):
    """The contents of a .json with changes."""
    try:
        return json.loads(Path(path).read_text())
    except ValueError as error:
        raise InputError(path, "changes", "not readable", str(error)) from None


def _take(block, name, expected, values, digest):
    """Set the values of a data-block that differ; returns whether any did."""
    if block is None:
        raise needs_copy(name, "missing")
    differs = values_and_digest(block)[1] != digest
    if not differs and expected == DIFFERENT:
        raise needs_copy(name, "without values that differ")
    for _ in range(ROUNDS if differs else 0):
        _set_values(block, values)
    if differs and values_and_digest(block)[1] != digest:
        raise needs_copy(name, "more than values")
    return differs


def needs_copy(name, change):
    """The InputError for a change that values cannot express."""
    return InputError(name, "change", change, "copy the file again")


def _set_values(block, values):
    """Set the values of a data-block that differ, by path, where Blender permits it."""
    before, _ = values_and_digest(block)
    for path in (path for path in values if path in before and _json_value(before[path]) != values[path]):
        head, _, name = path.rpartition(".")
        with suppress(AttributeError, RuntimeError, TypeError, ValueError):
            set_value(block.path_resolve(head) if head else block, name, values[path])


def set_value(owner, name, value):
    """Set a property, except for text, unless another one has determined it already."""
    now = getattr(owner, name)
    if isinstance(now, set):
        value = set(value)
    elif isinstance(value, list):
        value = [old if new is None else new for old, new in zip(flat(now), value, strict=True)]
        value = np.reshape(value, np.shape(now)).tolist()
    if owner.bl_rna.properties[name].type != "STRING" and _json_value(now) != _json_value(value):
        setattr(owner, name, value)


def _json_value(value):
    """A value of a property as JSON has it."""
    if isinstance(value, set):
        return sorted(value)
    return flat(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
