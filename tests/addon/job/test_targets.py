"""Output files: never over the user's files, or over files that the scene uses."""

import bpy
import numpy as np
import pytest

from lensfield import addon
from lensfield.addon.job.result import Result
from lensfield.engine.pictures.preview import write_png
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.files import MARK
from refusals import refused
from small_scenes import material, set_world, wall

OPTIONS = {"lens": "edmund-54852", "wavelengths_nm": [550.0]}
FOREIGN = "somebody's own"


@pytest.fixture
def quick_scene(scene, tmp_path):
    """A scene that renders quickly into a separate folder."""
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 12, 9, 1
    scene.lensfield.output_folder = str(tmp_path / "out")
    (tmp_path / "out").mkdir()
    set_world(scene)
    return scene


def files_of(scene, tmp_path):
    return Result.of(scene, tmp_path / "out", scene.frame_current).files


def test_all_files_of_a_render_are_recognised_as_ours(quick_scene, tmp_path):
    addon.render_through_lens(quick_scene, **OPTIONS)
    paths = files_of(quick_scene, tmp_path)
    assert all(path.is_file() for path in paths)
    again = addon.render_through_lens(quick_scene, **OPTIONS)  # is not refused
    addon.apply_lens(again.radiance, lens="tessar-50mm", lens_quality="preview")


@pytest.mark.parametrize("number", range(10))
def test_a_render_does_not_overwrite_files_of_the_user(quick_scene, tmp_path, number):
    path = files_of(quick_scene, tmp_path)[number]
    path.write_text(FOREIGN)
    attempts = (lambda: addon.render_through_lens(quick_scene, **OPTIONS),
                lambda: addon.render_animation(quick_scene, [quick_scene.frame_current], **OPTIONS),
                lambda: addon.render_through_lens(quick_scene, depth="traced", **OPTIONS | {"lens": "tessar-50mm"}))
    for attempt in attempts:
        with refused(InputError, field="file", value="an existing file that Lensfield did not write", where=path.name):
            attempt()
    assert path.read_text() == FOREIGN and list(path.parent.iterdir()) == [path]
    assert path.name in " ".join(map(str, addon.preflight(quick_scene, **OPTIONS).refusals))


def test_applying_a_lens_does_not_overwrite_files_of_the_user(quick_scene, tmp_path):
    result = addon.render_through_lens(quick_scene, **OPTIONS)
    other = tmp_path / "other"
    other.mkdir()
    for path in files_of(quick_scene, tmp_path):
        if path != result.radiance:
            foreign = other / path.name
            foreign.write_text(FOREIGN)
            with refused(InputError, field="file", value="an existing file that Lensfield did not write",
                         where=path.name):
                addon.apply_lens(result.radiance, lens="tessar-50mm", output_folder=other, lens_quality="preview")
            assert foreign.read_text() == FOREIGN
            foreign.unlink()


@pytest.mark.parametrize("use", ["texture", "spectrum"])
def test_a_render_does_not_overwrite_files_that_its_scene_uses(quick_scene, tmp_path, use):
    """A picture written by Lensfield may since have become a texture, on a screen in the scene for example."""
    of_wall, shader = material("Paint", "ShaderNodeBsdfDiffuse")
    wall(quick_scene, of_wall)
    path = files_of(quick_scene, tmp_path)[5]
    if use == "texture":
        write_png(np.ones((4, 4, 3)), path, 1.0)
        source = of_wall.node_tree.nodes.new("ShaderNodeTexImage")
        source.image = bpy.data.images.load(str(path))
        of_wall.node_tree.links.new(source.outputs["Color"], shader.inputs["Color"])
    else:
        path.write_text(f"# {MARK}\n400 0.1\n700 0.9\n")
        of_wall.lensfield.reflectance = str(path)
    before = path.read_bytes()
    with pytest.raises(InputError, match=f"{path.name}: file is an input of the scene: choose another output folder"):
        addon.render_through_lens(quick_scene, **OPTIONS)
    assert path.read_bytes() == before


def test_a_picture_that_only_the_compositor_uses_is_overwritten(quick_scene):
    addon.render_through_lens(quick_scene, to_compositor=True, **OPTIONS)
    addon.render_through_lens(quick_scene, to_compositor=True, **OPTIONS)


@pytest.mark.parametrize("name, refused", [("unsaved_Scene_0001_report.json", True), ("Any_-0012_REPORT.json", True),
                                           ("unsaved_Scene_0001_after.png", True), ("report.json", False),
                                           ("Scene_report.json", False)])
def test_a_report_cannot_have_the_name_of_a_frame_file(tmp_path, name, refused):
    addon.check_next_to_frames(tmp_path / "elsewhere", tmp_path / name)
    if not refused:
        addon.check_next_to_frames(tmp_path, tmp_path / name)
        return
    with pytest.raises(InputError, match="file is named like a rendered frame: choose another name or folder"):
        addon.check_next_to_frames(tmp_path, None, tmp_path / name)

