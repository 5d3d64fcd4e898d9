"""An empty frame: the reason is reported before the render if it can be known, and otherwise afterwards."""

import bpy
import pytest

from lensfield import addon, cli
from lensfield.addon import preflight
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from small_scenes import light, material, set_world, wall


@pytest.fixture
def lit(scene, tmp_path):
    """A grey wall in a lamp's light, off the axis, 16 x 10 px."""
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse")[0], side_m=1.0).location.x = 0.2
    light(scene, "POINT", 10.0)
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 16, 10, 1
    scene.lensfield.output_folder = str(tmp_path / "out")
    scene.lensfield.wavelength_count = 3
    return scene


def unlit(scene):
    scene.objects["Light"].hide_render = True


def lamp_of_no_power(scene):
    scene.objects["Light"].data.energy = 0


def hidden(scene):
    scene.objects["Wall"].hide_render = True


def away(scene):
    scene.objects["Wall"].location.z = 3


def clipped(scene):
    scene.camera.data.clip_end = 0.5


def not_for_the_camera(scene):
    scene.objects["Wall"].visible_camera = False


def boxed_in(scene):
    """A closed grey box around the camera, with the lamp outside."""
    bpy.ops.mesh.primitive_cube_add(size=0.5)
    bpy.context.object.name = "Box"
    bpy.context.object.data.materials.append(material("Cardboard", "ShaderNodeBsdfDiffuse")[0])
    scene.objects["Light"].location = 2, 1, 0


BLACK = [(unlit, "no light: no lamp or emissive material, and a black world"), (lamp_of_no_power, "no light: "),
         (hidden, "all objects (1) are hidden from renders"), (away, "no object is in the camera's view"),
         (clipped, "all objects in view are outside the camera's clip range, 0.001 to 0.5 m"),
         (not_for_the_camera, "all objects are hidden from the camera"),
         (boxed_in, "the camera is inside 'Box', a closed mesh that contains no light")]


def foreseen(scene):
    return [str(each) for each in preflight(scene).remarks if each.what == "Empty Frame"]


def reported(scene, **options):
    result = addon.render_through_lens(scene, spectral=SpectralOptions("preview"), depth="off", **options)
    return [line for line in result.messages if line.startswith("Empty Frame")]


@pytest.mark.parametrize("change, reason", BLACK, ids=lambda value: getattr(value, "__name__", ""))
def test_a_black_frame_is_explained_before_and_after_the_render(lit, change, reason):
    change(lit)
    bpy.context.view_layer.update()
    before, after = foreseen(lit), reported(lit)
    assert len(before) == 1 and before[0].startswith(f"Empty Frame black: {reason}") and "; " in before[0]
    assert after == before


@pytest.mark.parametrize("change, reason", [each for each in BLACK if each[0] in (hidden, away, clipped)],
                         ids=lambda value: getattr(value, "__name__", ""))
def test_a_transparent_frame_is_explained_under_a_bright_world(lit, change, reason):
    set_world(lit)
    lit.render.film_transparent = True
    change(lit)
    bpy.context.view_layer.update()
    before, after = foreseen(lit), reported(lit)
    assert len(before) == 1 and before[0].startswith(f"Empty Frame transparent: {reason}")
    assert after == before


def nothing(scene):
    pass


def lamp_in_the_box(scene):
    boxed_in(scene)
    scene.objects["Light"].location = 0.05, 0.1, 0


def window(scene):
    boxed_in(scene)
    mesh = scene.objects["Box"].data
    mesh.clear_geometry()
    mesh.from_pydata([(-0.25, -0.25, -0.25), (0.25, -0.25, -0.25), (0.25, 0.25, -0.25)], [], [(0, 1, 2)])
    scene.objects["Light"].location = 0.0, 0.0, 0.0


def glow(scene):
    unlit(scene)
    scene.objects["Wall"].data.materials[0] = material("Glow", "ShaderNodeEmission")[0]


def sky(scene):
    unlit(scene)
    hidden(scene)
    set_world(scene)


@pytest.mark.parametrize("change", [nothing, lamp_in_the_box, window, glow, sky])
def test_a_frame_with_light_has_no_remark(lit, change):
    change(lit)
    bpy.context.view_layer.update()
    assert foreseen(lit) == reported(lit) == []


def test_a_black_frame_of_unknown_cause_is_reported_as_such(lit):
    """A lamp behind the wall."""
    lit.objects["Light"].location = 0, 0, -2
    assert foreseen(lit) == []
    assert reported(lit) == ["Empty Frame black: no cause found in the scene's settings; compare with an F12 render"]


def test_only_the_render_region_counts(lit):
    """Its left half is black, and it excludes the wall on the right."""
    lit.objects["Wall"].location.x = 0.6
    lit.render.use_border, lit.render.border_max_x = True, 0.25
    assert reported(lit)[0].startswith("Empty Frame black: ")
    lit.render.border_max_x = 1.0
    assert reported(lit) == []


def test_frames_of_one_capture_are_explained_once(lit):
    unlit(lit)
    animation = addon.render_animation(lit, frames=(1, 2), lens="tessar-50mm", spectral=SpectralOptions("preview"))
    assert sum("no lamp" in line for line in animation.messages) == 1


def test_the_command_prints_the_remark(lit, tmp_path, capsys):
    unlit(lit)
    blend = str(tmp_path / "dark.blend")
    bpy.ops.wm.save_as_mainfile(filepath=blend)
    cli.main(["lint", blend])
    assert "Empty Frame black: no light" in capsys.readouterr().out


