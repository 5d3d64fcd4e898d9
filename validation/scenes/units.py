"""Units: scales, and scenes that are tiny, huge or far away."""

from .kit import ordinary


def _resize(stage, times):
    """Make everything this many times as large, as its lamps' watts."""
    for thing in stage.scene.objects:
        thing.location *= times
        if thing.type == "MESH":
            thing.scale = times, times, times
    camera = stage.camera
    camera.data.clip_start, camera.data.clip_end = 0.1 * times, 100 * times
    camera.data.dof.focus_distance *= times
    stage.lamp.data.size *= times
    stage.lamp.data.energy *= times**2


@ordinary()
def tiny_scene(stage):
    """A scene of two millimetres"""
    _resize(stage, 0.004)


@ordinary()
def huge_scene(stage):
    """A scene of two kilometres"""
    _resize(stage, 1000)


@ordinary()
def millimetres(stage):
    """A unit of a millimetre"""
    _resize(stage, 1000)
    stage.scene.unit_settings.scale_length = 0.001


@ordinary()
def centimetres(stage):
    """A unit of a centimetre"""
    _resize(stage, 100)
    stage.scene.unit_settings.scale_length = 0.01


@ordinary()
def without_units(stage):
    """Unit System: None, with a scale that is then ignored"""
    stage.scene.unit_settings.scale_length = 0.01
    stage.scene.unit_settings.system = "NONE"


@ordinary()
def feet(stage):
    """Imperial units"""
    _resize(stage, 1 / 0.3048)
    stage.scene.unit_settings.system, stage.scene.unit_settings.scale_length = "IMPERIAL", 0.3048
