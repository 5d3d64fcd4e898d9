"""Places of objects that have only moved, sent to a process that has prepared a copy of the file for its passes.

Wavelengths, materials, lamps and light groups do not depend on the places of objects, so none of them is prepared
again. That nothing else has changed follows from digests (`still_digests`): one of the time at which the other process
prepared the scene equals the present one.
"""

import json

import bpy

from lensfield.engine.runtime.files import atomic_path

from .changes import MAYBE, MOST_BLOCKS, name_of, needs_copy, read_changes, set_value, values_suffice
from .fingerprint import blocks_of, digest_without, values_and_digest

PLACE = frozenset({"location", "rotation_euler", "rotation_quaternion", "rotation_axis_angle", "delta_location",
                   "delta_rotation_euler", "delta_rotation_quaternion"})  # not scale: colours of fog depend on its size


def still_digests(scene, changed):
    """Digests of changed objects without their places, and of the scene's collections.

    Parameters
    ----------
    scene : bpy.types.Scene
    changed : dict
        From `changed_blocks`.

    Returns
    -------
    dict or None
        By ID type and full name; None if anything other than objects has changed.
    """
    blocks = {name_of(block): block for block in blocks_of(scene)}
    moved = {name for name in changed if name in blocks and name[0] != "COLLECTION"}
    read = moved | {name for name in blocks if name[0] == "COLLECTION"}
    if (any(name[0] != "OBJECT" or changed[name] != MAYBE for name in moved) or len(read) > MOST_BLOCKS
            or scene.animation_data or not values_suffice(scene, blocks.values())):
        return None
    return {name: digest_without(blocks[name], PLACE) for name in read}


def write_moves(path, still):
    """Write the places of the objects in the result of `still_digests` to a .json."""
    places = {obj.name_full: _place(obj) for obj in bpy.data.objects if name_of(obj) in still}
    with atomic_path(path, overwrite=True) as temporary:
        temporary.write_text(json.dumps(places))


def take_moves(scene, path):
    """Move the objects of a scene that was loaded from a copy to the places from `write_moves`.

    Raises
    ------
    InputError
        No object has moved, or one is missing or cannot be moved. Others may have been moved.
    """
    objects = {obj.name_full: obj for obj in bpy.data.objects}
    moved = [_move(objects.get(name), name, place) for name, place in read_changes(path).items()]
    if not any(moved):
        raise needs_copy(path, "empty")
    for layer in scene.view_layers:
        layer.update()


def _move(obj, name, place):
    """Move an object; returns whether it was elsewhere."""
    if obj is None:
        raise needs_copy(name, "missing")
    before = _place(obj)
    for field, value in place.items():
        set_value(obj, field, value)
    if _place(obj) != place:
        raise needs_copy(name, "more than a move")
    return place != before


def _place(obj):
    """The properties of an object's place by name, as JSON has them, without animated elements."""
    values, _ = values_and_digest(obj)
    return {name: values[name] for name in PLACE & values.keys()}
