"""Errors about scenes, told like the engine's."""

from ...engine.errors import InputError


class SceneError(InputError):
    """A scene that cannot be rendered as it stands."""
