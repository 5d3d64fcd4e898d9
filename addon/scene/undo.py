"""Journal: changes to a scene that are taken back, whatever happens."""

from contextlib import ExitStack

import bpy

from .errors import SceneError


class Journal:
    """Changes made through it are undone, last first, when the `with` block ends."""

    def __init__(self):
        self._undo = ExitStack()  # one that fails does not keep the others from being undone
        self._users, self._spent = {}, []
        self.on_exit(lambda: bpy.data.batch_remove(self._spent))  # at once: each removal goes through all of the file

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self._users.clear()  # whoever has come and gone since
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

    def stand_in(self, original):
        """A copy of a data-block that takes its place for everything that uses it, so that it is left untouched.

        Parameters
        ----------
        original : bpy.types.ID

        Returns
        -------
        the copy

        Raises
        ------
        SceneError
            Something linked from another file uses the original and cannot be pointed at the copy.
        """
        self.set(original, "use_fake_user", False)  # so that only real users count
        copy = original.copy()

        def take_back():
            self._replace(copy, original)
            self._spent.append(copy)

        self.on_exit(take_back)
        self._replace(original, copy)
        users = bpy.data.user_map(subset={original})[original] if original.users else ()
        if users:
            raise SceneError(f"{original.rna_type.name.lower()} {original.name!r}", "user",
                             f"{min(user.name for user in users)!r}, linked from another file",
                             "make it local (Object > Relations > Make Local > All)")
        return copy

    def _replace(self, old, new):
        """Let everything that uses `old` use `new`, where that can be done."""
        for user in self._users_of(old):
            for index, material in enumerate(getattr(user, "materials", ())):
                if material == old:
                    user.materials[index] = new
            for slot in getattr(user, "material_slots", ()):
                if slot.link == "OBJECT" and slot.material == old and not slot.is_property_readonly("material"):
                    slot.material = new
            if getattr(user, "data", None) == old:
                user.data = new
        if old.users:  # elsewhere too; this passes over linked users, and looks through all of the file
            old.user_remap(new)

    def _users_of(self, data_block):
        """Those known to use it: found for all of its kind at once, as each search goes through all of the file."""
        kind = data_block.id_type
        if kind not in self._users:
            self._users[kind] = bpy.data.user_map(key_types={kind})
        return self._users[kind].get(data_block, ())
