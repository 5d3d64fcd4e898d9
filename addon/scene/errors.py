"""Errors about scenes, in the engine's format."""

from lensfield.engine.runtime.errors import InputError


class SceneError(InputError):
    """A scene that cannot be rendered as it is."""


def blenders_reason(error):
    """The text of the RuntimeError of one of Blender's operators, without the word that starts it."""
    return str(error).strip().removeprefix("Error: ")
