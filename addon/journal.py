"""Journal: changes to a scene that are taken back, whatever happens."""

from contextlib import ExitStack

import bpy

from .errors import SceneError


class Journal:
    """Changes made through it are undone, last first, when the `with` block ends."""

    def __init__(self):
        self._undo = ExitStack()  # one that fails does not keep the others from being undone

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self._undo.close()

    def on_exit(self, undo):
        """Call `undo` when the block ends."""
        self._undo.callback(undo)

    def set(self, owner, attribute, value):
        """Set a property of a data-block."""
        old = getattr(owner, attribute)
        if old == value:
            return
        self.on_exit(lambda: setattr(owner, attribute, old))
        setattr(owner, attribute, value)

    def stand_in(self, original, collection):
        """A copy of a data-block that takes its place for everything that uses it, so that it is left untouched.

        Parameters
        ----------
        original : bpy.types.ID
        collection : the part of bpy.data that it belongs to

        Returns
        -------
        the copy

        Raises
        ------
        SceneError
            Something linked from another file uses the original and cannot be pointed at the copy.
        """
        copy = original.copy()

        def take_back():
            _replace(copy, original)
            collection.remove(copy)

        self.on_exit(take_back)
        users = _replace(original, copy)
        if users:
            raise SceneError(f"{original.rna_type.name.lower()} {original.name!r}", "user",
                             f"{min(user.name for user in users)!r}, linked from another file",
                             "make it local (Object > Relations > Make Local > All)")
        return copy


def _replace(old, new):
    """Let everything that uses `old` use `new`; the users for which that could not be done."""
    old.user_remap(new)
    for user in _users(old):  # linked data is passed over by user_remap, but may be assigned to
        for index, material in enumerate(getattr(user, "materials", ())):
            if material == old:
                user.materials[index] = new
        if getattr(user, "data", None) == old:
            user.data = new
    return _users(old)


def _users(data_block):
    return bpy.data.user_map(subset={data_block})[data_block]
