"""Journal: changes to a scene that are taken back, whatever happens."""


class Journal:
    """Changes made through it are undone, last first, when the `with` block ends."""

    def __init__(self):
        self._undo = []

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        failures = []
        while self._undo:
            try:
                self._undo.pop()()
            except Exception as failure:  # one that fails must not keep the others from being undone
                failures.append(failure)
        if failures:
            raise failures[0]

    def on_exit(self, undo):
        """Call `undo` when the block ends."""
        self._undo.append(undo)

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
        """
        copy = original.copy()

        def take_back():
            copy.user_remap(original)
            collection.remove(copy)

        self.on_exit(take_back)
        original.user_remap(copy)
        return copy
