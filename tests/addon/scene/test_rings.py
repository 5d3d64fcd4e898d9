"""Rings: focus and f-stop of the lens, set by the scene's camera."""

import json
from math import inf

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from lensfield import addon
from lensfield.addon.render.render import job_of_frame
from lensfield.addon.scene.rings import FIXED, ring_fields, rings_for, scene_lens, scene_rings
from lensfield.cli import _parser
from lensfield.commands.arguments import rings_option
from lensfield.commands.render import scene_and_fields
from lensfield.engine import load_lens
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.library import clamped_rings
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.prescription.tolerances import Copy
from lensfield.engine.rays.rings import AT_REST, Rings
from lensfield.request import RING_FIELDS, to_arguments
from small_scenes import WAVELENGTHS_NM, set_world

LENS = "tessar-50mm"


@pytest.fixture
def dof(scene):
    """The camera's depth of field, turned on."""
    scene.camera.data.dof.use_dof = True
    scene.camera.data.dof.focus_distance, scene.camera.data.dof.aperture_fstop = 1.2, 8.0
    return scene.camera.data.dof


def target(scene, *place, kind=None):
    obj = bpy.data.objects.new("Target", kind)
    scene.collection.objects.link(obj)
    obj.location = place
    scene.camera.data.dof.focus_object = obj
    bpy.context.view_layer.update()
    return obj


def test_a_lens_is_at_rest_without_depth_of_field(scene, dof):
    dof.use_dof = False
    assert scene_rings(scene) == AT_REST
    assert scene_rings(scene, focus="camera") == Rings(1200.0)
    assert scene_rings(scene, f_number=4.0) == Rings(None, 4.0)
    scene.camera.data.lensfield.focused_wide_open = True
    assert scene_rings(scene) == Rings(focused_wide_open=True)


def test_arguments_override_the_cameras_rings(scene, dof):
    assert scene_rings(scene) == Rings(1200.0, 8.0), "without the noise of Blender's floats"
    assert scene_rings(scene, focus=700.0) == Rings(700.0, 8.0)
    assert scene_rings(scene, focus=inf, f_number=2.8) == Rings(inf, 2.8)
    scene.camera.data.lensfield.focused_wide_open = True
    assert scene_rings(scene, focused_wide_open=False) == Rings(1200.0, 8.0)


def test_tilt_copy_and_coating_are_settings_of_the_camera(scene, dof):
    settings = scene.camera.data.lensfield
    settings.tilt_deg, settings.copy, settings.copy_grade = np.radians((4, -2.5)), 7, "DROPPED"
    settings.coating = "SINGLE"
    assert scene_rings(scene) == Rings(1200.0, 8.0, tilt_deg=(4.0, -2.5), copy=Copy(7, "dropped"), coating="single")
    assert scene_rings(scene, tilt_deg=(0.0, 0.0), copy=0, coating="lens") == Rings(1200.0, 8.0)


@pytest.mark.parametrize("place, distance_mm", [((0, 0, 3), 3000), ((1, 2, 3), 3000), ((0, 0, -2), 2000)])
def test_distance_to_a_focus_object_is_measured_along_the_camera_axis(scene, dof, place, distance_mm):
    """As in Blender; the camera looks along its own -z, and an object behind it counts as if in front."""
    scene.camera.matrix_world = Matrix.Translation((0.5, -0.25, 7)) @ Matrix.Scale(3.0, 4)
    x, y, z = place
    target(scene, 0.5 + x, -0.25 + y, 7 - z)
    assert scene_rings(scene).focus_mm == distance_mm


def test_the_focus_object_can_be_a_bone(scene, dof):
    rig = target(scene, 0.0, 0.0, scene.camera.matrix_world.translation.z - 5.0, kind=bpy.data.armatures.new("Rig"))
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bone = rig.data.edit_bones.new("Eye")
    bone.head, bone.tail = (0, 0, 1.5), (0, 0, 2)
    bpy.ops.object.mode_set(mode="OBJECT")
    rig_focus_mm = scene_rings(scene).focus_mm
    dof.focus_subtarget = "Eye"
    bpy.context.view_layer.update()
    assert rig_focus_mm - scene_rings(scene).focus_mm == pytest.approx(1500, rel=1e-5)


@pytest.mark.parametrize("view", ["lens", "camera"])
def test_the_lens_focuses_at_the_cameras_focus_distance(scene, dof, view):
    """Even if the camera is scaled."""
    lens, warning, words = scene_lens(scene, LENS, view, "preview")
    assert lens.object_distance_mm + lens.entrance_pupil_mm == pytest.approx(1200, rel=1e-3)
    assert words == () and bool(warning) == (view == "camera")


def test_settings_beyond_the_lens_range_are_reported(scene, dof):
    dof.aperture_fstop = 1.4
    words, = clamped_rings(LENS, Rings(f_number=1.4))
    assert words in scene_lens(scene, LENS, "lens", "preview")[2]
    preflight = addon.preflight(scene, lens=LENS, wavelengths_nm=WAVELENGTHS_NM, lens_quality="preview")
    assert [remark.becomes for remark in preflight.remarks if remark.what == "Focus and F-Stop"] == [words]


def test_a_lens_package_is_unchanged_and_reported_as_fixed(scene, dof, tmp_path):
    path = tmp_path / "own.npz"
    write_package(load_lens("edmund-54852"), path)
    lens, _, words = scene_lens(scene, path, "lens", "preview")
    assert lens == load_lens(path) and words == (FIXED,) and rings_for(scene, path) == AT_REST
    dof.use_dof = False
    assert scene_lens(scene, path, "lens", "preview")[2] == ()


def test_rings_follow_keyframes(scene, dof):
    for frame, distance_m in ((1, 0.8), (11, 1.8)):
        dof.focus_distance = distance_m
        dof.keyframe_insert("focus_distance", frame=frame)
    jobs = [job_of_frame(scene, frame, lens=LENS, wavelengths_nm=WAVELENGTHS_NM, lens_quality="preview")
            for frame in (1, 6, 11)]
    distances = [job.lens.object_distance_mm + job.lens.entrance_pupil_mm for job in jobs]
    assert distances[0] == pytest.approx(800, rel=1e-4) and distances[2] == pytest.approx(1800, rel=1e-4)
    assert 1000 < distances[1] < 1600 and scene.frame_current == 1


@pytest.mark.parametrize("rings", [AT_REST, Rings(1234.5), Rings(inf, 2.8), Rings(80.0, 5.6, True),
                                   Rings(tilt_deg=(-1.5, 0.0), copy=Copy(7, "dropped"), coating="ideal")])
def test_the_command_line_preserves_rings(rings):
    words = to_arguments(**ring_fields(rings))
    options = _parser().parse_args(["apply", "Scene_0001_radiance.exr", "--lens", LENS, *words])
    assert rings_option(options) == rings


@pytest.mark.parametrize("words, expected", [
    ([], {}),
    (["--focus", "CAMERA", "--f-number", "4"], {"focus": "camera", "f_number": 4.0}),
    (["--focus", "80cm", "--focused-wide-open"], {"focus": 800.0, "focused_wide_open": True}),
    (["--tilt=-1,2.5", "--copy", "3", "--coating", "multi"], {"tilt_deg": (-1.0, 2.5), "copy": 3, "coating": "multi"})])
def test_the_command_line_sets_rings(scene, tmp_path, words, expected):
    blend = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    options = _parser().parse_args(["render", str(blend), *words])
    given = scene_and_fields(options)[1]
    assert {name: given[name] for name in RING_FIELDS if name in given} == expected


def test_the_cameras_rings_affect_the_picture_and_its_record(scene, dof, tmp_path):
    set_world(scene)
    options = {"lens": LENS, "wavelengths_nm": [550], "lens_quality": "preview"}
    lights, lenses = [], []
    for dof.aperture_fstop in (8.0, 16.0):
        result = addon.render_through_lens(scene, output_folder=tmp_path, **options)
        lights.append(read_exr(result.irradiance).cube[0, 12:24, 16:32].mean())
        lenses.append(json.loads(result.record.read_text())["job"]["lens_digest"])
    assert lights[1] / lights[0] == pytest.approx(0.25, rel=0.01) and lenses[0] != lenses[1]
