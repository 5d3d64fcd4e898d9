"""Flamenco's job type: hidden without Flamenco's add-on; with it, selected if the Manager offers it, or saved."""

import bpy
import pytest

from layouts import Layout
from lensfield.addon.ui.animation import LENSFIELD_MT_animation
from lensfield.addon.ui.flamenco import JOB_TYPE, SCRIPT


class FLAMENCO_OT_submit_job(bpy.types.Operator):
    """As Flamenco's add-on registers it"""

    bl_idname = "flamenco.submit_job"
    bl_label = "Submit to Flamenco"


@pytest.fixture
def flamenco(scene):
    """The add-on; a function that sets the job types of its Manager."""
    types = [("-", "Select a Job Type", "")]
    bpy.utils.register_class(FLAMENCO_OT_submit_job)
    bpy.types.Scene.flamenco_job_type = bpy.props.EnumProperty(items=lambda scene, context: types)
    yield lambda name: types.append((name, name, ""))
    del bpy.types.Scene.flamenco_job_type
    bpy.utils.unregister_class(FLAMENCO_OT_submit_job)


def drawn(scene):
    class Menu:
        layout = Layout()

    LENSFIELD_MT_animation.draw(Menu, bpy.context)
    return str(Menu.layout.shown)


def test_without_flamenco_nothing_is_shown(scene):
    assert "flamenco" not in drawn(scene)
    assert not bpy.ops.lensfield.flamenco_job_type.poll()


def test_the_operator_selects_the_job_type(scene, flamenco):
    assert "flamenco_job_type" in drawn(scene)
    with pytest.raises(RuntimeError, match="has no Lensfield job type: save it"):
        bpy.ops.lensfield.flamenco_job_type()
    flamenco(JOB_TYPE)
    assert bpy.ops.lensfield.flamenco_job_type() == {"FINISHED"}
    assert scene.flamenco_job_type == JOB_TYPE == "lensfield-render"


def test_the_job_type_script_is_saved(scene, flamenco, tmp_path):
    path = tmp_path / "ö d" / SCRIPT.name
    for _ in range(2):
        bpy.ops.lensfield.save_flamenco_job_type(filepath=str(path))
        assert path.read_text() == SCRIPT.read_text()
    path.write_text("mine")
    with pytest.raises(RuntimeError, match="an existing file that Lensfield did not write"):
        bpy.ops.lensfield.save_flamenco_job_type(filepath=str(path))
    assert path.read_text() == "mine"
    with pytest.raises(RuntimeError, match="expected lensfield_render.js, the name"):
        bpy.ops.lensfield.save_flamenco_job_type(filepath=str(path.with_name("mine.js")))
