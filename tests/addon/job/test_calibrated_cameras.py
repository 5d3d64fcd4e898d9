"""Exported cameras of a scene: their numbers and poses put a point where the rendered picture shows it."""

import json

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix, Vector

from lensfield import addon
from lensfield.cli import main
from lensfield.engine.calibration.models import BROWN_CONRADY, KANNALA_BRANDT
from lensfield.engine.pictures.spectral_exr import read_exr
from small_scenes import material, set_world, wall

UNIT_M, NM, FRAME = 0.01, 587.5618, 7
POINTS = [("nikkor-28mm", BROWN_CONRADY, (0.55, 0.28, -1.0)), ("nikkor-28mm", BROWN_CONRADY, (-0.4, -0.25, -0.9)),
        ("muller-fisheye-25mm", KANNALA_BRANDT, (0.9, 0.4, -0.7)),
        ("muller-fisheye-25mm", KANNALA_BRANDT, (-0.5, -0.6, -0.8))]
"""Lenses, their models, and points in metres from the camera: to the right, upwards, backwards."""


def place_camera(scene, lens):
    """A turned and shifted camera of which only frame 7 is at the tested place."""
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", UNIT_M
    scene.render.resolution_x, scene.render.resolution_y = 110, 80
    camera = scene.camera
    camera.data.clip_start, camera.data.clip_end = 1, 1000
    camera.data.shift_x, camera.data.shift_y, camera.data.lensfield.lens = 0.08, -0.05, lens
    for frame, place in ((1, (0, 0, 0)), (FRAME, (120, -40, 30))):
        camera.location = place
        camera.keyframe_insert("location", frame=frame)
    camera.rotation_euler = 1.1, 0.3, -0.7
    scene.frame_set(FRAME)
    return Matrix.LocRotScale(Vector((120, -40, 30)), Euler((1.1, 0.3, -0.7)), None)


def add_bead(scene, to_world, place_m):
    """A small glowing square at a place from the camera."""
    bead = wall(scene, material("Bead", "ShaderNodeEmission", (1, 1, 1))[0], side_m=0.015 / UNIT_M)
    bead.matrix_world = to_world @ Matrix.Translation(Vector(place_m) / UNIT_M)
    bpy.context.view_layer.update()
    return np.array(bead.matrix_world.translation) * UNIT_M


def lit_px(scene, folder):
    """Column and row of the mean of the light in the lens's picture, by the convention of nerfstudio."""
    scene.cycles.samples = 256  # the bead is smaller than a pixel: few samples would miss most of its light
    result = addon.render_through_lens(scene, wavelengths_nm=[NM], output_folder=folder, depth="off",
                                       lens_quality="preview")
    light = read_exr(result.irradiance).cube[0]
    rows, columns = np.indices(light.shape)
    return np.array([(light * columns).sum(), (light * rows).sum()]) / light.sum() + 0.5


@pytest.mark.parametrize("lens, model, place_m", POINTS)
def test_a_point_is_where_the_exported_camera_sees_it(scene, tmp_path, lens, model, place_m):
    set_world(scene, (0, 0, 0))
    point_m = add_bead(scene, place_camera(scene, lens), place_m)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "bead.blend"))
    expected_px = lit_px(scene, tmp_path / "out")
    assert main(["lens", "calibration", "--scene", str(tmp_path / "bead.blend"), "--for", "nerfstudio", "--frames",
                 f"1,{FRAME}", "-o", str(tmp_path / "transforms.json"), "--model", model.name, "--lens-quality",
                 "preview"]) == 0
    contents = json.loads((tmp_path / "transforms.json").read_text())
    frame = contents["frames"][1]
    assert frame["file_path"] == f"bead_Scene_{FRAME:04d}_after.png" and (contents["w"], contents["h"]) == (110, 80)
    x, y, z, _ = np.linalg.inv(frame["transform_matrix"]) @ (*point_m, 1)
    np.testing.assert_allclose((x, y, z), place_m, atol=1e-5)
    coefficients = [contents[name] for name in model.coefficients]
    across, down = model.place(np.array([x, -y, -z]), coefficients)
    projected_px = contents["cx"] + contents["fl_x"] * across, contents["cy"] + contents["fl_y"] * down
    np.testing.assert_allclose(projected_px, expected_px, atol=0.15)  # samples of the bead, and coma


def focus_pull(scene, folder):
    """A .blend whose focus changes from frame 1 to 2, and stays from there on."""
    place_camera(scene, "tessar-50mm")
    dof = scene.camera.data.dof
    dof.use_dof, dof.aperture_fstop = True, 4
    for frame, distance_m in ((1, 1.0), (2, 8.0), (4, 8.0)):
        dof.focus_distance = distance_m / UNIT_M
        scene.camera.data.keyframe_insert("dof.focus_distance", frame=frame)
    path = folder / "pull.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def test_each_frame_has_its_focus(scene, tmp_path, capsys):
    command = ["lens", "calibration", "--scene", str(focus_pull(scene, tmp_path)), "--for", "nerfstudio", "-o",
               str(tmp_path / "transforms.json"), "--lens-quality", "preview"]
    assert main([*command, "--frames", "1,2"]) == 0
    assert capsys.readouterr().err == "lens: f/4 is wider than this lens opens: set to f/5.5\n"
    near, far = json.loads((tmp_path / "transforms.json").read_text())["frames"]
    assert near["fl_x"] > 1.02 * far["fl_x"]
    assert main([*command, "--frames", "3", "--for", "opencv"]) == 1


def test_stmaps_are_written_where_the_focus_changes(scene, tmp_path):
    command = ["lens", "stmap", "--scene", str(focus_pull(scene, tmp_path)), "--output", str(tmp_path / "maps"),
               "--lens-quality", "preview"]
    assert main([*command, "--frames", "1-4"]) == 0
    names = {f"pull_{frame}_{name}.exr" for frame in ("0001", "0002") for name in ("distort", "undistort")}
    assert {path.name for path in (tmp_path / "maps").iterdir()} == names
    assert main(command) == 0 and (tmp_path / "maps" / "pull_distort.exr").exists()


def test_cameras_need_a_lens_or_a_scene(tmp_path, capsys):
    output = "--for", "colmap", "-o", str(tmp_path / "cameras.txt"), "--resolution", "64x48"
    assert main(["lens", "calibration", *output]) == 1
    assert main(["lens", "calibration", "tessar-50mm", "--frames", "1-3", *output]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert "NAME|FILE is not given" in lines[0] and "--frames is 1-3: also give --scene" in lines[1]
