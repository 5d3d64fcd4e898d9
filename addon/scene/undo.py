"""Journal: changes to a scene that are undone in any case."""

from contextlib import ExitStack

import bpy

from .errors import SceneError


class Journal:
    """Changes made through it are undone, last first, when the `with` block ends."""

    def __init__(self):
        self._undo = ExitStack()  # undoes the others even if one fails
        self._users, self._spent = {}, []
        self.on_exit(lambda: bpy.data.batch_remove(self._spent))  # together: each removal scans the complete file

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self._users.clear()  # users may have changed since
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
        """A copy that replaces a data-block for all its users, so that the original stays untouched.

        Parameters
        ----------
        original : bpy.types.ID

        Returns
        -------
        the copy

        Raises
        ------
        SceneError
            A data-block linked from another file uses the original and cannot be changed to use the copy.
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
        """Let all users of `old` use `new` where possible."""
        for user in self._users_of(old):
            for index, material in enumerate(getattr(user, "materials", ())):
                if material == old:
                    user.materials[index] = new
            for slot in getattr(user, "material_slots", ()):
                if slot.link == "OBJECT" and slot.material == old and not slot.is_property_readonly("material"):
                    slot.material = new
            if getattr(user, "data", None) == old:
                user.data = new
        if old.users:  # other kinds of users; this ignores linked ones, and scans the complete file
            others = bpy.data.user_map(subset={old})[old]
            old.user_remap(new)
            for user in others:  # which Blender does not: evaluated users would keep a pointer to the removed block
                user.update_tag()

    def _users_of(self, data_block):
        """A data-block's known users: searched for all of its kind together, as each search scans the complete file."""
        kind = data_block.id_type
        if kind not in self._users:
            self._users[kind] = bpy.data.user_map(key_types={kind})
        return self._users[kind].get(data_block, ())
