"""The whole chain's geometry: where a point in space lands, worked out from the lens's own tables."""

import bpy
import numpy as np
import pytest
from small_scenes import material, render, set_world

from lensfield.addon.camera import make_framing, pitch_um
from lensfield.addon.errors import SceneError
from lensfield.engine import Lens
from lensfield.engine.exr import read_exr

LENS = Lens.load("edmund-54852")
WAVELENGTH_NM = 562.0
COLUMN = int(np.flatnonzero(np.isclose(LENS.wavelengths_nm, WAVELENGTH_NM))[0])


def bead(scene, x_mm, y_mm, z_mm, radius_mm):
    glow, shader = material("Glow", "ShaderNodeEmission", (1, 1, 1))
    shader.inputs["Strength"].default_value = 100
    bpy.ops.mesh.primitive_uv_sphere_add(radius=radius_mm * 1e-3, location=(x_mm * 1e-3, y_mm * 1e-3, z_mm * 1e-3))
    bpy.context.object.data.materials.append(glow)


def centroid_mm(image):
    """Centroid of an image, x to the right and y upwards from the axis."""
    plane = image.cube[0].astype(float)
    rows, columns = np.mgrid[:plane.shape[0], :plane.shape[1]]
    x = (columns - image.centre_px[1]) * image.pitch_um * 1e-3
    y = (image.centre_px[0] - rows) * image.pitch_um * 1e-3
    return (x * plane).sum() / plane.sum(), (y * plane).sum() / plane.sum()


@pytest.mark.parametrize("height_index, azimuth_deg", [(10, 0), (12, 90), (14, 180), (10, 270), (18, 37), (18, 217)])
def test_bead_in_the_object_plane_lands_at_the_real_chief_ray_height(scene, tmp_path, height_index, azimuth_deg):
    scene.render.resolution_x, scene.render.resolution_y = 320, 240
    paraxial_mm = LENS.heights_mm[height_index]
    object_height_mm = paraxial_mm / abs(LENS.magnification)
    direction = np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))])
    pupil_to_object_mm = LENS.object_distance_mm + LENS.entrance_pupil_mm
    bead(scene, *(object_height_mm * direction), -pupil_to_object_mm, radius_mm=2.0)
    result = render(scene, tmp_path, [WAVELENGTH_NM])

    pixel_mm = 4.8 / 320
    ideal_mm = centroid_mm(read_exr(result.radiance))
    np.testing.assert_allclose(ideal_mm, paraxial_mm * direction, atol=0.1 * pixel_mm)
    # The PSF's centroid lies a few micrometres off the chief ray (coma), well under a third of a pixel here.
    real_mm = centroid_mm(read_exr(result.irradiance))
    expected_mm = LENS.real_height_mm[COLUMN, height_index] * direction
    np.testing.assert_allclose(real_mm, expected_mm, atol=0.3 * pixel_mm)


def test_uniform_world_gives_the_irradiance_of_equation_2_over_the_whole_frame(scene, tmp_path):
    set_world(scene)
    scene.world.lensfield.emission = "380:1, 780:1"
    image = read_exr(render(scene, tmp_path, [WAVELENGTH_NM]).irradiance)
    on_axis = np.pi * LENS.transmittance[COLUMN] * (1 / 400) / (4 * LENS.f_number_effective**2)
    rows, columns = np.mgrid[:image.cube.shape[1], :image.cube.shape[2]]
    real_mm = np.hypot(rows - image.centre_px[0], columns - image.centre_px[1]) * image.pitch_um * 1e-3
    inside = real_mm < LENS.real_height_mm[COLUMN, -1]
    profile = np.interp(real_mm, LENS.real_height_mm[COLUMN], LENS.relative_illumination[COLUMN])
    np.testing.assert_allclose(image.cube[0][inside], (on_axis * profile)[inside], rtol=3e-3)
    assert image.cube.min() > 0.9 * on_axis  # no dark border: the overscan reaches far enough


def test_frame_just_fits_the_sensor(scene):
    assert pitch_um(LENS, (576, 768)) == pytest.approx(6.25)
    assert pitch_um(LENS, (1080, 1920)) == pytest.approx(2.5)
    assert pitch_um(LENS, (768, 576)) == pytest.approx(3600 / 768)


def test_overscan_covers_barrel_distortion_at_the_corner(scene):
    scene.render.resolution_x, scene.render.resolution_y = 768, 576
    framing = make_framing(scene, LENS, [550.0])
    # The corner, 3.0 mm off the axis, lies past the table: its paraxial height is at least 3.0 / (1 - 0.084).
    at_least_px = (1 / (1 - 0.084) - 1) * 384
    assert at_least_px < framing.overscan_px[1] < 2 * at_least_px
    assert framing.overscan_px[0] == pytest.approx(framing.overscan_px[1] * 0.75, abs=6)


@pytest.mark.parametrize("attribute, value, message", [
    ("type", "ORTHO", "camera 'Camera': type is ORTHO"), ("shift_x", 0.1, "camera 'Camera': shift is 0.1")])
def test_unfit_camera_is_refused_by_name(scene, tmp_path, attribute, value, message):
    setattr(scene.camera.data, attribute, value)
    with pytest.raises(SceneError, match=message):
        render(scene, tmp_path)


def test_missing_camera_is_refused(scene, tmp_path):
    scene.camera = None
    with pytest.raises(SceneError, match="camera is missing"):
        render(scene, tmp_path)


def test_match_camera_gives_the_lens_field_of_view(scene):
    scene.render.resolution_x, scene.render.resolution_y = 768, 576
    assert bpy.ops.lensfield.match_camera() == {"FINISHED"}
    # 2.4 mm paraxial is 100.2 mm in the object plane, 254.06 mm from the entrance pupil: 21.5 degrees.
    assert np.degrees(scene.camera.data.angle_x) == pytest.approx(2 * 21.52, abs=0.05)
