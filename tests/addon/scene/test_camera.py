"""The geometry of the complete chain: the image positions of points in space, computed from the lens's tables."""

from dataclasses import replace

import bpy
import numpy as np
import OpenEXR
import pytest

from lensfield.addon.scene.camera import (
    CAMERA_SENSOR_MM,
    capture_grid,
    check_camera,
    lens_for_view,
    match_camera_to_lens,
    pitch_um,
    set_up_capture,
)
from lensfield.addon.scene.errors import SceneError
from lensfield.addon.scene.lens_facts import facts_of
from lensfield.addon.scene.undo import Journal
from lensfield.engine import Options, SpectralImage, load_lens, simulate
from lensfield.engine.depth.depth_range import planar_depth_mm
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.psf_samples import psf_radius_px
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.projection import PLANE
from lensfield.engine.image.sampling import Sampling
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.plan.choose import make_plan
from lensfield.engine.stray.options import StrayOptions
from refusals import refused
from small_scenes import material, render, set_world, wall
from varied_lenses import varied_lens

LENS = load_lens("edmund-54852")
WAVELENGTH_NM = 562.0
COLUMN = int(np.flatnonzero(np.isclose(LENS.wavelengths_nm, WAVELENGTH_NM))[0])


SAMPLES = 80
CENTROID_PX = 0.1
"""5 sigma of the centroid of a disk of radius r px, 5 / sqrt(6 pi r SAMPLES), for the smallest, 1.7 px.

The formula assumes that the samples inside the pixels of its rim are random.
"""


def bead(scene, x_mm, y_mm, z_mm, radius_mm):
    glow, shader = material("Glow", "ShaderNodeEmission", (1, 1, 1))
    shader.inputs["Strength"].default_value = 100
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius_mm * 1e-3, location=(x_mm * 1e-3, y_mm * 1e-3, z_mm * 1e-3))
    bpy.context.object.data.materials.append(glow)


def assert_centroid(image, place_mm, atol_mm):
    """Of the light around a position, x to the right and y upwards from the axis."""
    plane = image.cube[0].astype(float)
    rows, columns = np.mgrid[:plane.shape[0], :plane.shape[1]]
    x = (columns - image.centre_px[1]) * image.pitch_um * 1e-3
    y = (image.centre_px[0] - rows) * image.pitch_um * 1e-3
    light = np.where(np.hypot(x - place_mm[0], y - place_mm[1]) < 0.3, plane, 0)
    centroid_mm = np.array([(x * light).sum(), (y * light).sum()]) / light.sum()
    np.testing.assert_allclose(centroid_mm, place_mm, atol=atol_mm)


def shown_in_capture_mm(image, height_mm, focal_mm):
    """Radius in a capture of a paraxial height: the place where its polynomial equals the angle."""
    radius = np.linspace(0, 3, 300001)
    angle_rad = sum(number * radius**power for power, number in enumerate(image.projection.angle_per_radius, 1))
    return focal_mm * np.interp(np.arctan(height_mm / focal_mm), angle_rad, radius)


def test_beads_in_the_object_plane_land_at_the_real_chief_ray_height(scene, tmp_path):
    scene.render.resolution_x, scene.render.resolution_y = 320, 240
    scene.cycles.samples = SAMPLES
    pupil_to_object_mm = LENS.object_distance_mm + LENS.entrance_pupil_mm
    places = [(height_index, np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))]))
              for height_index, azimuth_deg in ((10, 0), (12, 90), (14, 180), (10, 270), (18, 37), (18, 217))]
    for height_index, direction in places:
        object_height_mm = LENS.heights_mm[height_index] / abs(LENS.magnification)
        bead(scene, *(object_height_mm * direction), -pupil_to_object_mm, radius_mm=2.0)
    result = render(scene, tmp_path, [WAVELENGTH_NM], depth="off")

    pixel_mm = 4.8 / 320
    ideal, real = (read_exr(path) for path in (result.radiance, result.irradiance))
    for height_index, direction in places:
        shown_mm = shown_in_capture_mm(ideal, LENS.heights_mm[height_index], LENS.capture_focal_length_mm)
        assert_centroid(ideal, shown_mm * direction, CENTROID_PX * pixel_mm)
        # The PSF's centroid is a few micrometres off the chief ray (coma), well under a fifth of a pixel here.
        assert_centroid(real, LENS.real_height_mm[COLUMN, height_index] * direction, 0.3 * pixel_mm)


def test_uniform_world_gives_the_irradiance_of_equation_2_across_the_frame(scene, tmp_path):
    set_world(scene)
    scene.world.lensfield.emission = "380:1, 780:1"
    image = read_exr(render(scene, tmp_path, [WAVELENGTH_NM], stray=StrayOptions("off")).irradiance)
    on_axis = np.pi * LENS.transmittance[COLUMN] * (1 / 400) / (4 * LENS.f_number_effective**2)
    rows, columns = np.mgrid[:image.cube.shape[1], :image.cube.shape[2]]
    real_mm = np.hypot(rows - image.centre_px[0], columns - image.centre_px[1]) * image.pitch_um * 1e-3
    inside = real_mm < 2.6  # farther out, coma moves more light than the tolerance
    profile = np.interp(real_mm, LENS.real_height_mm[COLUMN], LENS.relative_illumination[COLUMN])
    # The table is of chief rays; pixels receive the mean over PSFs.
    np.testing.assert_allclose(image.cube[0][inside], (on_axis * profile)[inside], rtol=3.5e-3)
    assert image.cube.min() > 0.9 * on_axis  # no dark border: the overscan is sufficient


def test_frame_just_fits_the_sensor(scene):
    assert pitch_um(LENS, (576, 768)) == pytest.approx(6.25)
    assert pitch_um(LENS, (1080, 1920)) == pytest.approx(2.5)
    assert pitch_um(LENS, (768, 576)) == pytest.approx(6.25)  # the sensor is turned for a portrait
    assert pitch_um(LENS, (600, 600)) == pytest.approx(6)


def test_overscan_covers_blur_and_little_else(scene):
    scene.render.resolution_x, scene.render.resolution_y = 768, 576
    for method in ("exact", "auto"):  # with complete and with trimmed PSFs
        options = Options(method=method)
        grid = capture_grid(scene, LENS, [550.0], options)
        blur_px = make_plan(options, LENS, Sampling(grid, (550.0,))).psf_radius_px
        assert all(blur_px < overscan < blur_px + 5 for overscan in grid.overscan_px)
    assert blur_px < psf_radius_px(LENS, grid.pitch_um) - 3


def test_unsuitable_camera_is_rejected_by_name(scene, tmp_path):
    scene.camera.data.type = "ORTHO"
    with pytest.raises(SceneError, match="camera 'Camera': type is ORTHO: .*set Type to Perspective"):
        render(scene, tmp_path)


def test_missing_camera_is_rejected(scene, tmp_path):
    scene.camera = None
    with refused(SceneError, field="camera", value="missing", where="scene 'Scene'"):
        render(scene, tmp_path)


def test_match_camera_gives_the_lens_field_of_view(scene):
    scene.camera.data.lensfield.lens = LENS.name
    scene.render.resolution_x, scene.render.resolution_y = 768, 576
    assert bpy.ops.lensfield.match_camera() == {"FINISHED"}
    # 2.4 mm paraxial is 100.2 mm in the object plane, 254.06 mm from the entrance pupil: 21.5 degrees.
    assert np.degrees(scene.camera.data.angle_x) == pytest.approx(2 * 21.52, abs=0.05)


PLACES = ((0, 0), (3, 0), (5, 90), (5, 217), (10, 33), (10, 146), (11, 323))  # field height, azimuth in degrees


def wide_lens():
    """Baked by the first test that needs it: a bake at import would delay every collection."""
    return varied_lens("muller-fisheye-25mm")


def wide_angles_deg():
    """26, 35, 57 and 61 at the heights 3, 5, 10 and 11."""
    return np.degrees(np.arctan(wide_lens().heights_mm / wide_lens().efl_mm))


def wide_real_height_mm():
    return wide_lens().at_wavelength(WAVELENGTH_NM).real_height_mm


def shoot(scene, folder, shape_px, pass_name="Combined"):
    """Render the scene unchanged with this many rows and columns, and a box filter; returns a pass's first channel."""
    render, image = scene.render, scene.render.image_settings
    render.resolution_y, render.resolution_x = shape_px
    render.filepath = str(folder / "shot.exr")
    scene.cycles.pixel_filter_type, scene.cycles.use_denoising = "BOX", False
    scene.view_layers[0].use_pass_z = True
    if hasattr(image, "media_type"):
        image.media_type = "MULTI_LAYER_IMAGE"
    image.file_format, image.color_depth = "OPEN_EXR_MULTILAYER", "32"
    bpy.ops.render.render(write_still=True)
    with OpenEXR.File(render.filepath, separate_channels=True) as file:
        channels = {name: channel.pixels for part in file.parts for name, channel in part.channels.items()}
    return next(values for name, values in sorted(channels.items(), reverse=True) if f".{pass_name}." in name)


def direction(angle_deg, azimuth_deg):
    angle, azimuth = np.radians((angle_deg, azimuth_deg))
    return np.array([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), -np.cos(angle)])


def beads_around(scene):
    scene.cycles.samples = SAMPLES
    for height_index, azimuth_deg in PLACES:
        bead(scene, *(2000 * direction(wide_angles_deg()[height_index], azimuth_deg)), radius_mm=20)


def assert_lit_places(plane, radius_mm, pitch_um, atol_px):
    """Checks the centroid of the light at every bead's position."""
    rows, columns = np.mgrid[:plane.shape[0], :plane.shape[1]]
    x_px, y_px = columns - (plane.shape[1] - 1) / 2, (plane.shape[0] - 1) / 2 - rows
    for height_index, azimuth_deg in PLACES:
        radius_px = radius_mm[height_index] / (pitch_um * 1e-3)
        expected = radius_px * np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))])
        light = np.where(np.hypot(x_px - expected[0], y_px - expected[1]) < 12, plane, 0).astype(float)
        centroid = np.array([(x_px * light).sum(), (y_px * light).sum()]) / light.sum()
        np.testing.assert_allclose(centroid, expected, atol=atol_px, err_msg=f"at height {height_index}")


@pytest.fixture
def wide(scene):
    """The capture for a lens of 140 degrees, 320 x 240 px of 150 um, with the camera set up for it."""
    scene.render.resolution_x, scene.render.resolution_y = 320, 240
    grid = capture_grid(scene, wide_lens(), [WAVELENGTH_NM])
    set_up_capture(scene.camera.data, wide_lens(), grid, Journal())
    return grid


def test_a_capture_images_a_direction_at_the_radius_of_its_projection(scene, wide, tmp_path):
    """And the projection follows the lens to half a pixel, at the reference wavelength."""
    assert not wide.projection.is_plane and wide.pitch_um == pytest.approx(150)
    beads_around(scene)
    shown_mm = shown_in_capture_mm(wide, wide_lens().heights_mm, wide_lens().efl_mm)
    assert_lit_places(shoot(scene, tmp_path, wide.shape_px), shown_mm, wide.pitch_um, atol_px=CENTROID_PX)
    used = wide_real_height_mm() < np.hypot(*wide.frame_px) / 2 * 0.15
    np.testing.assert_allclose(shown_mm[used], wide_real_height_mm()[used], atol=0.5 * 0.15)


def test_the_lens_maps_a_panorama_to_its_real_image_heights(scene, wide, tmp_path):
    beads_around(scene)
    radiance = SpectralImage(shoot(scene, tmp_path, wide.shape_px), [WAVELENGTH_NM], pitch_um=wide.pitch_um,
                             overscan_px=wide.overscan_px, projection=wide.projection)
    assert_lit_places(simulate(radiance, wide_lens()).cube[0], wide_real_height_mm(), wide.pitch_um, atol_px=0.3)


def test_uniform_light_is_uniform_across_a_panorama(scene, wide, tmp_path):
    set_world(scene)
    plane = shoot(scene, tmp_path, wide.shape_px)
    corner_mm = np.hypot(*wide.shape_px) / 2 * wide.pitch_um * 1e-3
    assert np.degrees(wide.projection.angle_rad(corner_mm / wide_lens().capture_focal_length_mm)) > 69
    np.testing.assert_allclose(plane, 1.0, rtol=1e-5)


def test_a_panorama_needs_a_fifth_of_the_pixels_of_a_plane(scene, wide):
    frame, reach_px = PixelGrid(wide.frame_px, wide.pitch_um), psf_radius_px(wide_lens(), wide.pitch_um)
    plane = field_map(wide_lens()).overscan_px(frame, [WAVELENGTH_NM], reach_px)
    as_plane = np.prod([n + 2 * margin for n, margin in zip(wide.frame_px, plane, strict=True)])
    assert np.prod(wide.shape_px) < 0.22 * as_plane


def test_depth_of_a_wall_is_constant_with_either_camera(scene, wide, tmp_path):
    wall(scene, material("White", "ShaderNodeBsdfDiffuse")[0], distance_m=2.0, side_m=20)
    distance_mm = 1e3 * shoot(scene, tmp_path, wide.shape_px, "Depth")
    depth_mm = planar_depth_mm(distance_mm, wide_lens(), wide)
    finite = np.isfinite(depth_mm)
    assert finite.mean() > 0.9
    # A pixel's single sample may be half a pixel off, where the distance is up to tan(70 deg) / f times that offset.
    np.testing.assert_allclose(depth_mm[finite], 2000, rtol=0.15 * np.sqrt(0.5) * 2.75 / 25.25 * 1.2)
    as_plane = replace(wide, projection=PLANE)
    set_up_capture(scene.camera.data, wide_lens(), as_plane, Journal())
    depth_mm = 1e3 * shoot(scene, tmp_path, (24, 32), "Depth")
    np.testing.assert_allclose(planar_depth_mm(depth_mm, wide_lens(), PixelGrid((24, 32), 150.0)), 2000, rtol=1e-5)


def test_a_plane_capture_restores_perspective_after_a_panorama(scene, wide):
    grid = replace(capture_grid(scene, LENS, [WAVELENGTH_NM]), projection=PLANE)
    set_up_capture(scene.camera.data, LENS, grid, Journal())
    camera = scene.camera.data
    assert camera.type == "PERSP"
    width_mm = grid.shape_px[1] * grid.pitch_um * 1e-3
    assert np.tan(camera.angle_x / 2) == pytest.approx(width_mm / 2 / LENS.capture_focal_length_mm, rel=1e-5)


def test_match_camera_to_a_wide_lens_shows_the_exact_frame(scene, tmp_path):
    match_camera_to_lens(scene.camera.data, facts_of(wide_lens()), PixelGrid((240, 320), 150.0))
    check_camera(scene)
    beads_around(scene)
    assert_lit_places(shoot(scene, tmp_path, (240, 320)), wide_real_height_mm(), 150.0, atol_px=0.3)


def test_match_camera_to_a_wide_lens_gives_solid_viewports_the_same_width(scene):
    match_camera_to_lens(scene.camera.data, facts_of(wide_lens()), PixelGrid((240, 320), 150.0))
    side_deg = np.interp(24.0, wide_real_height_mm(), wide_angles_deg())
    assert np.degrees(np.arctan(CAMERA_SENSOR_MM / 2 / scene.camera.data.lens)) == pytest.approx(side_deg, abs=0.1)


def test_other_panoramas_are_rejected(scene):
    scene.camera.data.type = "PANO"
    scene.camera.data.panorama_type = "EQUIRECTANGULAR"
    with refused(SceneError, field="panorama type", value="EQUIRECTANGULAR", where="camera 'Camera'"):
        check_camera(scene)


@pytest.mark.parametrize("frame", [(1080, 1920), (1920, 1080), (600, 600)])
@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize("unit", ["MILLIMETERS", "FOV"])
def test_an_adapted_lens_has_the_cameras_view(scene, frame, fit, unit):
    camera = scene.camera.data
    camera.sensor_fit, camera.sensor_width, camera.sensor_height = fit, 23.5, 15.6
    camera.lens_unit = unit
    if unit == "FOV":
        camera.angle = np.radians(40)
    else:
        camera.lens = 35.0
    scene.render.resolution_y, scene.render.resolution_x = frame
    corners = np.array([corner[:] for corner in camera.view_frame(scene=scene)])  # Blender's own
    half_tangents = np.abs(corners[:, :2] / corners[:, 2:]).max(axis=0)
    adapted, _ = lens_for_view(scene, LENS, "camera")
    sensor_mm = np.array(adapted.sensor_mm)
    np.testing.assert_allclose(sensor_mm / 2 / adapted.capture_focal_length_mm, half_tangents, rtol=1e-5)
    assert adapted.capture_focal_length_mm == pytest.approx(camera.lens, rel=1e-9)
    assert pitch_um(adapted, frame) == pytest.approx(1e3 * adapted.sensor_mm[0] / frame[1])  # square; full sensor


def test_the_warning_describes_the_adapted_lens(scene):
    camera = scene.camera.data
    camera.lens, camera.sensor_width = 35.0, 36.0
    scene.render.resolution_y, scene.render.resolution_x = 1080, 1920
    adapted, warning = lens_for_view(scene, LENS, "camera")
    assert lens_for_view(scene, LENS, "camera")[0] is adapted  # allows the frames of an animation to share data
    factor = 35 / (0.0239542 * 254.058)  # |m| times the object's distance from the entrance pupil
    assert factor == pytest.approx(5.751, abs=1e-3)
    # 250 mm is 1.44 m. 3 mm minus 8.4 % are 15.80 mm of the 20.65 mm of half the diagonal of 36 x 20.25 mm.
    assert "enlarged to 34.5 mm to match your camera (scaled by 5.75) and focused at 1.44 m" in warning
    assert "covers 84% of the frame's diagonal" in warning and "\n" not in warning


def test_a_lens_focused_at_infinity_is_adapted_by_its_focal_length(scene):
    scene.camera.data.lens = 12.625
    adapted, warning = lens_for_view(scene, wide_lens(), "camera")
    assert adapted.efl_mm == pytest.approx(12.625) and "focused at infinity" in warning


def test_a_lens_is_not_adapted_to_a_fisheye(scene, wide):
    with pytest.raises(SceneError, match="camera 'Camera': type is PANO: .*set Type to Perspective"):
        lens_for_view(scene, LENS, "camera")


def test_the_lens_view_needs_no_camera(scene):
    scene.camera = None
    assert lens_for_view(scene, LENS, "lens") == (LENS, "")
    assert lens_for_view(scene, LENS, "4x3") == (replace(LENS, sensor_mm=(4, 3)), "")


def test_beads_land_at_the_same_place_in_mm_on_another_sensor(scene, tmp_path):
    scene.render.resolution_x, scene.render.resolution_y = 180, 256  # a portrait, on 2.5 mm of the 2.7 x 3.84 mm
    scene.cycles.samples = SAMPLES
    direction, height_index = np.array([-0.6, 0.8]), 11
    height_mm = direction * LENS.heights_mm[height_index] / abs(LENS.magnification)
    bead(scene, *height_mm, -LENS.object_distance_mm - LENS.entrance_pupil_mm, radius_mm=2.0)
    image = read_exr(render(scene, tmp_path, [WAVELENGTH_NM], depth="off", view="3.84x2.7").irradiance)
    assert image.pitch_um == pytest.approx(15)
    assert_centroid(image, LENS.real_height_mm[COLUMN, height_index] * direction, 0.3 * 15e-3)


def test_a_sensor_beyond_the_field_is_reported(scene):
    adapted, warning = lens_for_view(scene, LENS, "phone")
    assert adapted is lens_for_view(scene, LENS, "phone")[0]
    assert replace(adapted, sensor_mm=LENS.sensor_mm) == LENS and adapted.digest != LENS.digest
    # the lens data reach the corner of the lens's own sensor: 3 mm of the 6.125 mm of half the diagonal
    assert "covers 49% of the diagonal of a sensor of 9.8 x 7.35 mm" in warning
