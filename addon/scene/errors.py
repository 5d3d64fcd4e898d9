"""Errors about scenes, in the engine's format."""

from ...engine.runtime.errors import InputError


class SceneError(InputError):
    """A scene that cannot be rendered as it is."""
