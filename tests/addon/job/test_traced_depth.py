"""Depth "traced": Cycles' render through the lens itself is the frame's irradiance."""

import json
from dataclasses import replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from afocal import AFOCAL
from lensfield.addon import render_through_lens
from lensfield.addon.render.child import preview_arguments
from lensfield.addon.render.preflight import preflight
from lensfield.addon.scene import devices, traced_camera
from lensfield.engine import InputError, load_lens
from lensfield.engine.bake.bake import bake
from lensfield.engine.bake.quality import SKETCH
from lensfield.engine.depth.depth_range import blur_px
from lensfield.engine.lens.entrance_pupil import entrance_pupil_diameter_mm, focus_nearness
from lensfield.engine.lens.pinhole import fitting_pitch_um
from lensfield.engine.library import prescription_of
from lensfield.engine.pictures.spectral_exr import read_exr, read_parts
from lensfield.engine.prescription.tolerances import Copy
from lensfield.engine.rays.rings import AT_REST, Rings, turned
from lensfield.engine.stray.options import StrayOptions
from noise import assert_means
from refusals import refused
from small_scenes import material, set_region, set_world, wall
from snapshot import differences, snapshot

LENS = "edmund-54852"


def traced(scene, folder, wavelengths_nm=(550.0,), lens=LENS, **options):
    return render_through_lens(scene, lens=lens, wavelengths_nm=wavelengths_nm, output_folder=folder, depth="traced",
                               **options)


def irradiance(result):
    return read_exr(result.irradiance).cube.astype(np.float64)


@pytest.fixture
def lamp(scene):
    """A glowing square in the plane in focus, off the axis."""
    lit = wall(scene, material("Glow", "ShaderNodeEmission")[0], distance_m=0.19, side_m=0.04)
    lit.location.x, lit.location.y = 0.03, 0.015
    return scene


def test_each_wavelength_is_traced_separately(scene, tmp_path):
    """Glass absorbs the blue light, and its index determines where light lands."""
    set_world(scene)
    nm = 400.0, 550.0, 700.0
    result = traced(scene, tmp_path, nm)
    even = irradiance(result).mean(axis=(1, 2))
    assert result.report.scene.passes == 3 and "one wavelength" in result.report.scene.scene_plan
    layers = render_through_lens(scene, lens=LENS, wavelengths_nm=nm, output_folder=tmp_path)
    assert_means(irradiance(result), irradiance(layers).mean(axis=(1, 2)), 0.01, noise=0.03)
    assert even[1] / even[0] != pytest.approx(1, abs=0.01)  # otherwise the test could not distinguish them


def test_a_traced_render_writes_lens_files_and_removes_pinhole_files(lamp, tmp_path):
    earlier = render_through_lens(lamp, lens=LENS, wavelengths_nm=(550.0,), output_folder=tmp_path)
    assert earlier.radiance.is_file() and earlier.before.is_file()
    result = traced(lamp, tmp_path)
    assert not result.radiance.exists() and not result.before.exists()
    record = json.loads(result.record.read_text())
    assert {"radiance", "before"}.isdisjoint(record["files"]) and record["job"]["depth"] == "traced"
    for name in record["files"]:
        assert getattr(result, name).is_file()
    assert any("no diffraction" in line for line in record["scene_remarks"])


def test_the_scene_is_restored(lamp, tmp_path):
    traced(lamp, tmp_path)  # for the same random numbers
    before = snapshot()
    traced(lamp, tmp_path, (500.0, 600.0))
    assert not differences(before, snapshot())


@pytest.mark.every_blender
def test_the_camera_may_have_any_position_and_scale(lamp, tmp_path):
    expected = irradiance(traced(lamp, tmp_path / "here"))
    holder = bpy.data.objects.new("Holder", None)
    lamp.collection.objects.link(holder)
    for part in (lamp.camera, bpy.data.objects["Wall"]):
        part.parent = holder
    holder.location, holder.rotation_euler = (3, -2, 5), (0.4, 1.1, -0.7)
    lamp.camera.scale = 2, 3, 4
    moved = irradiance(traced(lamp, tmp_path / "there"))
    assert np.abs(moved - expected).sum() < 0.02 * expected.sum()  # of the same random numbers


def test_a_region_equals_that_part_of_the_full_frame(lamp, tmp_path):
    full = irradiance(traced(lamp, tmp_path / "whole"))
    lamp.render.use_border = True
    lamp.render.border_min_x, lamp.render.border_max_x = 0.5, 1.0
    lamp.render.border_min_y, lamp.render.border_max_y = 0.5, 1.0
    part = irradiance(traced(lamp, tmp_path / "part"))
    assert part[:, :18, 24:].any() and not part[:, 18:].any() and not part[:, :, :24].any()
    assert_means(part[:, :18, 24:], full[:, :18, 24:].mean(axis=(1, 2)), 1e-3, noise=0.5)


def test_the_cameras_view_scales_the_lens(lamp, tmp_path):
    """The lens is scaled as a unit: an object at a distance scaled by the same factor gives the same picture."""
    lens = load_lens(LENS)
    expected = irradiance(traced(lamp, tmp_path / "lens"))
    camera, (width_mm, _) = lamp.camera.data, lens.sensor_mm
    camera.sensor_fit, camera.sensor_width, camera.lens = "HORIZONTAL", 3 * width_mm, 3 * lens.capture_focal_length_mm
    lit = bpy.data.objects["Wall"]
    lit.location, lit.scale = 3 * lit.location, (3, 3, 3)
    scaled = irradiance(traced(lamp, tmp_path / "camera", view="camera"))
    assert np.abs(scaled - expected).sum() < 0.02 * expected.sum()


@pytest.mark.parametrize("region", [False, True])
def test_alpha_is_the_covered_share_of_the_light(scene, tmp_path, region):
    """Without noise, also where there is nothing: the mean of noise that is cut off at 0 would be a veil."""
    glow = wall(scene, material("Glow", "ShaderNodeEmission")[0], distance_m=0.19)
    glow.location.x = 5.0  # its edge is in the middle
    tint = wall(scene, material("Tint", "ShaderNodeBsdfTransparent", (0.7, 0.7, 0.7))[0], distance_m=0.19)
    tint.location.x, tint.location.y = -5.0, 5.0
    scene.render.film_transparent, scene.cycles.samples = True, 8
    if region:
        set_region(scene, 0.1, 0.9, 0.2, 0.9)
    alpha = read_parts(traced(scene, tmp_path).lens_image)[0][1]["A"].astype(np.float64)
    visible = alpha[4:-8, 5:-5] if region else alpha
    assert np.all(visible[:, 28:] == 1)
    np.testing.assert_allclose(alpha[4:14, 5:20], 0.3, atol=1e-3)  # half-float precision
    assert np.all(alpha[22:, :20] == 0)


def test_blur_has_the_width_of_first_order_optics(scene, tmp_path):
    """A disc of uniform light has an RMS radius of its diameter over sqrt 8."""
    lens, depth_mm = load_lens(LENS), 60.0
    lamp = wall(scene, material("Glow", "ShaderNodeEmission")[0], 1e-3 * depth_mm, side_m=2e-4)
    lamp.active_material.cycles.emission_sampling = "NONE"
    scene.cycles.samples = 1024
    scene.render.use_border = True
    scene.render.border_min_x, scene.render.border_max_x = 0.3, 0.7
    scene.render.border_min_y, scene.render.border_max_y = 0.3, 0.7
    scene.render.resolution_x, scene.render.resolution_y = 192, 144
    picture = irradiance(traced(scene, tmp_path))[0]
    y, x = np.mgrid[:144, :192] - np.reshape([71.5, 95.5], (2, 1, 1))
    radius_px = np.sqrt(np.average(x**2 + y**2, weights=picture))
    pitch_um = fitting_pitch_um(lens, (144, 192))
    assert entrance_pupil_diameter_mm(lens) > 0
    assert radius_px == pytest.approx(float(blur_px(lens, pitch_um, depth_mm)) / np.sqrt(8), rel=0.05)


def test_a_package_is_refused_in_one_line(lamp, tmp_path):
    lens = replace(load_lens(LENS), prescription=None)
    with pytest.raises(InputError, match="edmund-54852: surface data is not in the package: .* prescription, or"):
        traced(lamp, tmp_path, lens=lens)


def anamorphic():
    triplet = prescription_of("cooke-triplet-50mm")
    lens = replace(triplet, surfaces=AFOCAL + triplet.surfaces, coating="ideal")  # without ghosts, which rays lack
    return turned(lens, Rings(2000.0, 4.0)).prescription


def tilted_copy():
    lens = replace(prescription_of(LENS), coating="ideal")
    return turned(lens, Rings(tilt_deg=(3.0, -2.0), copy=Copy(7, "dropped"))).prescription


def spot(picture):
    """Its light, and the centroid and RMS radii of the light over rows and columns."""
    places = np.indices(picture.shape)
    centroid = np.array([np.average(place, weights=picture) for place in places])
    squares = [np.average((place - middle)**2, weights=picture) for place, middle in
               zip(places, centroid, strict=True)]
    return picture.sum(), centroid, np.sqrt(squares)


@pytest.mark.parametrize("make, depth, nearness", [(anamorphic, "auto", 1 / 350), (tilted_copy, "off", None)])
def test_a_lens_without_symmetry_puts_a_lamp_where_its_data_do(make, depth, nearness, scene, tmp_path):
    """Nearer than the focus of an anamorphic lens, and in focus through a tilted copy, on a shifted sensor."""
    lens = replace(bake(make(), quality=SKETCH, wavelengths_nm=(500, 550, 600), samples=17, pitch_um=4.0),
                   prescription=make())
    place_mm = np.array([0.22, 0.17]) * lens.sensor_mm
    depth_m = 1e-3 / (nearness or focus_nearness(lens, *place_mm))
    tangent = place_mm * (lens.squeeze, 1) / lens.capture_focal_length_mm
    lit = wall(scene, material("Glow", "ShaderNodeEmission")[0], depth_m, side_m=0.8 * tangent[1] * depth_m)
    lit.location.x, lit.location.y = tangent * depth_m
    lit.active_material.cycles.emission_sampling = "NONE"
    scene.camera.data.clip_start, scene.camera.data.shift_x, scene.camera.data.shift_y = 1e-3, 0.06, -0.03
    scene.render.resolution_x, scene.render.resolution_y = 96, 72
    spots = {}
    for name, samples in (("traced", 256), (depth, 128)):
        scene.cycles.samples = samples
        result = render_through_lens(scene, lens=lens, wavelengths_nm=(550.0,), depth=name, stray=StrayOptions("off"),
                                     output_folder=tmp_path / name)
        spots[name] = spot(irradiance(result)[0])
    (light, centroid, radii), (expected, true, true_radii) = spots.values()
    assert light == pytest.approx(expected, rel=0.03)
    np.testing.assert_allclose(centroid, true, atol=0.15)
    np.testing.assert_allclose(radii, true_radii, rtol=0.05)


def test_a_blender_without_osl_is_refused_before_the_render(lamp, tmp_path, monkeypatch):
    monkeypatch.setattr(traced_camera, "_cycles", SimpleNamespace(with_osl=False))
    refusals = preflight(lamp, output_folder=tmp_path, lens=LENS, depth="traced").refusals
    assert any("OSL" in str(each) and "blender.org" in str(each) for each in refusals)
    with refused(InputError, field="OSL", value="missing from this build", where="Blender"):
        traced(lamp, tmp_path)


def test_gpus_without_optix_fall_back_to_the_cpu(lamp, tmp_path, monkeypatch):
    monkeypatch.setattr(devices, "devices_present", lambda: {"cuda": ["A card"]})
    result = traced(lamp, tmp_path, device="cuda")
    assert irradiance(result).any() and result.report.as_dict()["device"] == "CPU"


def test_a_preview_keeps_the_light_for_other_lenses(lamp, tmp_path):
    lamp.lensfield.depth = "TRACED"
    key = LENS, "lens", "hold", AT_REST, None, ("", 0.0, 0.0, True)
    arguments = preview_arguments(lamp, key, copy=tmp_path / "copy.blend", size=(8, 6), samples=1)
    assert "--depth=auto" in arguments
