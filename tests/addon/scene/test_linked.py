"""Data-blocks linked from another file: they render, and cannot be changed by mistake; scenes are chosen by name."""

import bpy
import pytest

from lensfield import addon
from lensfield.addon.scene.errors import SceneError
from lensfield.addon.scene.requirements import check_scene
from small_scenes import light, material, wall


@pytest.fixture
def lit_scene(scene):
    """A scene that renders."""
    light(scene, "POINT", 20.0)
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0])
    return scene


@pytest.fixture
def linked(lit_scene, tmp_path):
    """Makes a data-block of the scene one that is linked from a library."""
    def link(kind, name):
        path = tmp_path / "library.blend"
        bpy.data.libraries.write(str(path), {getattr(bpy.data, kind)[name]})
        with bpy.data.libraries.load(str(path), link=True) as (_, loaded):
            setattr(loaded, kind, [name])
        return getattr(loaded, kind)[0]

    return link


def test_what_a_linked_camera_lacks_is_changed_in_its_file_or_in_an_override(lit_scene, linked):
    """Blender would silently drop a change of linked data when it saves the file."""
    lit_scene.camera.data.type = "ORTHO"
    camera = lit_scene.camera = linked("objects", lit_scene.camera.name)
    lit_scene.collection.objects.link(camera)
    for operator in (lambda: bpy.ops.lensfield.fix(obstacle="type"), bpy.ops.lensfield.match_camera):
        with pytest.raises(RuntimeError, match=r"data-block is linked from .*library.blend|Orthographic cameras"):
            operator()
    assert camera.data.type == "ORTHO"
    camera.override_create(remap_local_usages=True).data.override_create(remap_local_usages=True)
    assert bpy.ops.lensfield.fix(obstacle="type") == {"FINISHED"} and lit_scene.camera.data.type == "PERSP"
    assert bpy.ops.lensfield.match_camera() == {"FINISHED"}
    check_scene(lit_scene)


def test_a_linked_camera_is_not_matched_to_the_lens(lit_scene, linked):
    lit_scene.camera.data.type, lit_scene.camera.data.lens = "PERSP", 90
    lit_scene.camera = linked("objects", lit_scene.camera.name)
    with pytest.raises(RuntimeError, match="camera 'Camera': data-block is linked from .*library.blend: change it in"):
        bpy.ops.lensfield.match_camera()
    assert lit_scene.camera.data.lens == 90


def test_a_linked_scene_is_refused_before_the_render(lit_scene, linked, tmp_path):
    """Its lens image and settings could not be saved."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    with pytest.raises(SceneError, match="scene 'Scene': data-block is linked from .*library.blend: open that file"):
        addon.render_through_lens(linked("scenes", lit_scene.name), output_folder=tmp_path / "out")
    assert not (tmp_path / "out").exists()
