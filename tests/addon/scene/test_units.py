"""The length of a Blender unit: a scene of the same physical size gives the same picture in any units."""

import bpy
import numpy as np
import pytest

from cycles_pictures import picture
from lensfield import addon
from lensfield.addon.capture.slabs import looked_at
from lensfield.addon.capture.unlayered import MIRRORED, unlayered
from lensfield.addon.job.recorded import picture_settings
from lensfield.addon.scene.bodies import uncut_depths_mm
from lensfield.addon.scene.camera import aim_camera, capture_grid
from lensfield.addon.scene.depth import visible_depth_mm
from lensfield.addon.scene.fingerprint import settings_digest
from lensfield.addon.scene.rings import scene_rings
from lensfield.addon.scene.units import depth_pass_m, metres_per_unit
from lensfield.engine import load_lens
from lensfield.engine.pictures.spectral_exr import read_exr, read_parts
from small_scenes import material, set_world, wall

LENS = "tessar-50mm"
SCALES = 0.1, 0.01, 0.001
WAVELENGTHS_NM = 480.0, 620.0
SMALL = load_lens("edmund-54852")


def in_units(scene, unit_m):
    """Set a scene unit to this many metres, and scale the camera's clipping."""
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", unit_m
    scene.camera.data.clip_start, scene.camera.data.clip_end = 0.01 / unit_m, 100 / unit_m


def test_the_background_is_as_far_in_any_unit():
    np.testing.assert_array_equal(depth_pass_m(np.float32([[4.0, 1e10]]), 0.5), np.float32([[2.0, 1e10]]))


def plate(scene, unit_m, kind, colour, place_m, side_m, tilt=0.0):
    """A square at this position, in metres."""
    obj = wall(scene, material(f"{kind} {place_m}", kind, colour)[0], side_m=side_m / unit_m)
    obj.location = [n / unit_m for n in place_m]
    obj.rotation_euler.x = tilt
    return obj


def still_life(scene, unit_m):
    """Glowing plates from 0.35 m to 3 m, off the axis; one is a ramp through the plane of focus, at 0.6 m."""
    in_units(scene, unit_m)
    scene.render.resolution_x, scene.render.resolution_y = 44, 30
    set_world(scene, (0.02, 0.03, 0.05))
    plate(scene, unit_m, "ShaderNodeEmission", (1.0, 0.2, 0.1), (0.06, 0.03, -0.35), 0.05)
    plate(scene, unit_m, "ShaderNodeEmission", (0.1, 0.8, 0.3), (-0.05, -0.04, -0.6), 0.5, tilt=1.2)
    plate(scene, unit_m, "ShaderNodeEmission", (0.3, 0.3, 1.0), (0.4, 0.2, -3.0), 0.8)
    dof = scene.camera.data.dof
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, 0.6 / unit_m, 4.5
    bpy.context.view_layer.update()


def lens_picture(scene, folder, **options):
    result = addon.render_through_lens(scene, lens=LENS, wavelengths_nm=WAVELENGTHS_NM, output_folder=folder,
                                       lens_quality="preview", **options)
    (_, depth), = read_parts(result.depth)
    return read_exr(result.irradiance).cube, next(iter(depth.values())), result.report


@pytest.fixture(scope="module")
def metre_picture(request, tmp_path_factory):
    """The still life in metres: irradiance, depth and report. Created on first use, in a separate scene."""
    return {}


@pytest.mark.sample(2)
@pytest.mark.parametrize("depth", ["auto", "traced"])
@pytest.mark.parametrize("unit_m", SCALES)
def test_the_same_scene_in_other_units_gives_the_same_picture(scene, tmp_path, metre_picture, unit_m, depth):
    if depth not in metre_picture:
        still_life(scene, 1.0)
        metre_picture[depth] = lens_picture(scene, tmp_path / "metres", depth=depth)
        for obj in [obj for obj in scene.objects if obj.type == "MESH"]:
            bpy.data.objects.remove(obj)
    still_life(scene, unit_m)
    expected, expected_m, in_metres = metre_picture[depth]
    cube, depth_m, report = lens_picture(scene, tmp_path / "units", depth=depth)
    brightest = expected.max()
    # The random numbers are the same: only a sample within single precision of an edge may cross it.
    assert np.abs(cube - expected).mean() < 1e-3 * brightest
    visible = (expected_m < 1e10) & (depth_m < 1e10)
    assert ((expected_m < 1e10) == (depth_m < 1e10)).mean() > 0.99 and visible.mean() > 0.2
    assert np.mean(np.isclose(depth_m[visible], expected_m[visible], rtol=1e-4)) > 0.99
    assert depth_m.min() == pytest.approx(expected_m.min(), rel=1e-4)
    if depth == "auto":
        assert depth_m.min() == pytest.approx(0.35, rel=1e-4)
        assert report.scene.layers == in_metres.scene.layers != ""
        assert report.scene.depth.nearest_mm == pytest.approx(350, rel=1e-4)
        assert report.scene.depth.outside_fraction == pytest.approx(in_metres.scene.depth.outside_fraction, abs=0.01)


@pytest.mark.parametrize("unit_m", SCALES)
def test_focus_by_distance_and_by_object_follows_the_unit(scene, unit_m):
    still_life(scene, unit_m)
    assert scene_rings(scene).focus_mm == pytest.approx(600, rel=1e-5)
    target = bpy.data.objects.new("Target", None)
    target.location = 0.3 / unit_m, 0.1 / unit_m, -1.7 / unit_m
    scene.collection.objects.link(target)
    scene.camera.data.dof.focus_object = target
    bpy.context.view_layer.update()
    assert scene_rings(scene).focus_mm == pytest.approx(1700, rel=1e-5)


@pytest.mark.parametrize("unit_m", SCALES)
def test_depths_of_traced_rays_are_in_metres(scene, unit_m):
    in_units(scene, unit_m)
    mirror = plate(scene, unit_m, "ShaderNodeBsdfGlossy", (1, 1, 1), (0.1, 0.0, -1.0), 3.0)
    mirror.active_material.node_tree.nodes["Glossy BSDF"].inputs["Roughness"].default_value = 0.0
    plate(scene, unit_m, "ShaderNodeEmission", (1, 1, 1), (0.1, 0.0, 4.0), 9.0)
    bpy.ops.mesh.primitive_cube_add(size=0.1 / unit_m, location=(0.02 / unit_m, 0.01 / unit_m, -0.5 / unit_m))
    scene.render.resolution_x, scene.render.resolution_y = 960, 600
    bpy.context.view_layer.update()
    fast = SMALL.scaled(10)
    grid = capture_grid(scene, fast, [550.0])
    depth_mm = visible_depth_mm(scene, fast, grid)
    assert np.nanmin(depth_mm) == pytest.approx(450, rel=1e-4) and np.nanmax(depth_mm) == pytest.approx(1000, rel=1e-4)
    corner_mm = 1e3 * np.linalg.norm((0.07, 0.06, 0.55))  # of the cube: a panorama clips by distance
    assert uncut_depths_mm(scene, fast, looked_at(grid), ()) == ([], [pytest.approx((450, corner_mm), rel=1e-4)])
    assert unlayered(scene, fast, grid)[MIRRORED].share > 0.3


def test_mirrored_shares_do_not_depend_on_the_unit(scene):
    """A mirror's blur differs from the blur of the reflected object by more than a pixel up to a distance in metres."""
    scene.render.resolution_x, scene.render.resolution_y = 480, 360
    fast, shares = SMALL.scaled(2), []  # with it, most of the difference is little more than a pixel
    for unit_m in (1.0, *SCALES):
        for obj in [obj for obj in scene.objects if obj.type == "MESH"]:
            bpy.data.objects.remove(obj)
        in_units(scene, unit_m)
        mirror = plate(scene, unit_m, "ShaderNodeBsdfGlossy", (1, 1, 1), (0.0, 0.0, -2.0), 6.0)
        mirror.active_material.node_tree.nodes["Glossy BSDF"].inputs["Roughness"].default_value = 0.0
        plate(scene, unit_m, "ShaderNodeEmission", (1, 1, 1), (0.0, 0.0, -1.2), 60.0, tilt=1.5)
        bpy.context.view_layer.update()
        shares.append({kind: content.share for kind, content in unlayered(
            scene, fast, capture_grid(scene, fast, [550.0])).items()})
    assert 0.4 < shares[0][MIRRORED] < 0.5
    assert all(share == pytest.approx(shares[0]) for share in shares[1:])


def test_without_a_unit_system_a_unit_is_a_metre(scene):
    scene.unit_settings.scale_length = 0.01
    assert metres_per_unit(scene) == 0.01  # not 0.00999999978
    digests = [settings_digest(scene)]
    scene.unit_settings.system = "IMPERIAL"
    assert metres_per_unit(scene) == 0.01
    digests.append(settings_digest(scene))
    scene.unit_settings.system = "NONE"
    assert metres_per_unit(scene) == 1
    assert digests[0] == digests[1] != settings_digest(scene)


def test_frames_of_another_scale_are_rendered_again(scene):
    before = picture_settings(scene)
    scene.unit_settings.scale_length = 0.1
    assert picture_settings(scene) != before


def test_a_new_camera_frames_a_scene_in_millimetres(scene):
    in_units(scene, 0.001)
    plate(scene, 0.001, "ShaderNodeEmission", (1, 1, 1), (0.0, 40.0, 0.0), 90.0)
    bpy.context.view_layer.update()
    aim_camera(scene)
    assert scene.camera.location.length * 0.001 > 60  # in metres; corners beyond 10 km are excluded


@pytest.mark.parametrize("unit_m", [1.0, 0.1])
def test_a_scene_too_far_away_to_blur_is_reported(scene, tmp_path, unit_m):
    in_units(scene, unit_m)
    plate(scene, unit_m, "ShaderNodeEmission", (1, 1, 1), (3.0, 1.0, -57.0), 30.0)
    bpy.context.view_layer.update()
    options = {"lens": LENS, "wavelengths_nm": WAVELENGTHS_NM, "output_folder": tmp_path, "lens_quality": "preview"}
    before, = (str(each) for each in addon.preflight(scene, **options).remarks if each.what == "Unit Scale")
    assert "most of the picture is about 57 m away; beyond" in before and "set Unit Scale" in before
    assert before in addon.render_through_lens(scene, **options).report.remarks()


@pytest.mark.parametrize("unit_m", [1.0, 0.1])
def test_a_scene_near_enough_to_blur_is_not_reported(scene, tmp_path, unit_m):
    in_units(scene, unit_m)
    plate(scene, unit_m, "ShaderNodeEmission", (1, 1, 1), (0.3, 0.1, -3.0), 9.0)
    scene.render.resolution_x, scene.render.resolution_y = 960, 600
    bpy.context.view_layer.update()
    preflight = addon.preflight(scene, output_folder=tmp_path, lens=LENS, lens_quality="preview")
    assert "Unit Scale" not in [each.what for each in preflight.remarks]


def test_cycles_depth_of_field_treats_a_unit_as_a_metre(scene, tmp_path):
    """At a scale of 0.1 its blur is a tenth of the lens's: its aperture is the focal length in units over 2000 N."""
    plate(scene, 1.0, "ShaderNodeEmission", (1, 1, 1), (0.2, 0.1, -4.0), 0.2)
    camera = scene.camera.data
    camera.lens, camera.dof.use_dof, camera.dof.focus_distance, camera.dof.aperture_fstop = 50.0, True, 1.0, 0.5
    pictures = []
    for scale in (1.0, 0.1):
        scene.unit_settings.scale_length = scale
        pictures.append(picture(scene, tmp_path, samples=16, columns=64, rows=64))
    np.testing.assert_array_equal(*pictures)
    held = pictures[0][0] > 0
    pixel = 36 / 50 / 64  # tangent of the angle of a pixel
    across = np.ptp(np.flatnonzero(held.any(axis=0))) + 1
    expected = (0.2 / 4 + 0.1 * (1 / 1.0 - 1 / 4)) / pixel  # of the plate, and a disc of 50 mm / 0.5 = 0.1 units
    assert across == pytest.approx(expected, abs=1.5)
