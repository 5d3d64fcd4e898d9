"""The iris: blades that stop a lens down, according to the camera's Aperture and the settings."""

import json
from dataclasses import replace
from math import inf, radians

import bpy
import numpy as np
import pytest

from lensfield import addon
from lensfield.addon.job.recorded import recorded_fields
from lensfield.addon.render.render import job_of_frame
from lensfield.addon.scene import rings
from lensfield.addon.scene.rings import scene_iris, scene_lens
from lensfield.cli import _parser
from lensfield.commands.arguments import iris_option
from lensfield.engine import InputError, load_lens, simulate
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.entrance_pupil import entrance_pupil_diameter_mm
from lensfield.engine.lens.iris import Iris, opening
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.library import PRESCRIPTIONS
from lensfield.engine.pictures.frame_record import read_record
from lensfield.engine.pictures.spectral_exr import read_parts
from lensfield.request import to_arguments
from refusals import refused
from small_scenes import material, set_world, wall

LENS = "tessar-50mm"
ENLARGED = 24  # factor by which the used part of the sensor is smaller


@pytest.fixture
def blades(scene):
    """The camera's depth of field, stopped down by six blades."""
    dof = scene.camera.data.dof
    dof.use_dof, dof.focus_distance, dof.aperture_fstop = True, 1.2, 8.0
    dof.aperture_blades, dof.aperture_rotation, scene.camera.data.lensfield.iris_roundness = 6, radians(15), 0.25
    return dof


def test_a_damaged_prescription_is_read_again_after_it_changes(scene, blades, tmp_path, monkeypatch):
    """A preview reads it many times a second."""
    path, calls, shows = tmp_path / "own.toml", [], rings.iris_is_visible
    monkeypatch.setattr(rings, "iris_is_visible", lambda *of: calls.append(of) or shows(*of))
    path.write_text("title = ")
    for _ in range(3):
        with refused(InputError, field="TOML", value="not readable", where="own.toml"):
            scene_iris(scene, str(path))
    assert len(calls) == 1
    path.write_bytes((PRESCRIPTIONS / f"{LENS}.toml").read_bytes())
    assert scene_iris(scene, str(path)).blades == 6 and len(calls) == 2


def test_the_cameras_blades_apply_unless_the_lens_is_wide_open(scene, blades):
    assert scene_iris(scene, LENS) == Iris(6, 15.0, 0.25), "without the noise of Blender's floats"
    assert scene_iris(scene, LENS, Iris(5)) == Iris(5) and scene_iris(scene, LENS, Iris(0)) is None
    assert scene_iris(scene, LENS, f_number=5.5) is None, "the widest that it has"
    blades.aperture_fstop = 1.4
    assert scene_iris(scene, LENS) is None and scene_iris(scene, LENS, f_number=11.0) == Iris(6, 15.0, 0.25)
    blades.aperture_fstop, blades.aperture_blades = 8.0, 2
    assert scene_iris(scene, LENS) is None, "which Cycles takes for none, too"
    blades.aperture_blades, blades.use_dof = 6, False
    assert scene_iris(scene, LENS) is None and scene_iris(scene, LENS, f_number=8.0) is None


def test_a_lens_without_rings_has_only_explicit_blades(scene, blades, tmp_path):
    lens = load_lens("edmund-54852")
    write_package(lens, tmp_path / "own.npz")
    assert scene_iris(scene, tmp_path / "own.npz") is None and scene_iris(scene, tmp_path / "own.npz", Iris(5)) is None
    assert scene_iris(scene, lens) is None and scene_iris(scene, lens, Iris(5)) == Iris(5)


def test_blades_can_be_keyframed_and_are_recorded(scene, blades, tmp_path):
    for frame, roundness in ((1, 0.0), (11, 1.0)):
        scene.camera.data.lensfield.iris_roundness = roundness
        scene.camera.data.lensfield.keyframe_insert("iris_roundness", frame=frame)
    options = {"lens": LENS, "wavelengths_nm": [550], "lens_quality": "preview"}
    jobs = [job_of_frame(scene, frame, **options) for frame in (1, 6, 11)]
    assert [job.iris.roundness for job in jobs] == pytest.approx([0, 0.5, 1])
    set_world(scene)
    result = addon.render_through_lens(scene, output_folder=tmp_path, **options)
    for changed, finished in (({"state": ""}, True), ({"iris": Iris(7)}, False)):
        job = recorded_fields(replace(jobs[0], **changed))
        assert bool(read_record(result.record, job, result.written_by(jobs[0]))) == finished
    assert json.loads(result.record.read_text())["job"]["iris"]["blades"] == 6


def test_a_stretched_aperture_is_ignored_and_reported(scene, blades):
    options = {"lens": LENS, "wavelengths_nm": [550], "lens_quality": "preview"}
    assert not any("Aperture" in str(remark) for remark in addon.preflight(scene, **options).remarks)
    blades.aperture_ratio = 2.0
    assert "Aperture Ratio 2: ignored" in map(str, addon.preflight(scene, **options).remarks)


@pytest.mark.parametrize("iris", [None, Iris(5), Iris(9, -12.5, 0.5), Iris(6, 1e-7, 1.0)])
def test_the_command_line_preserves_blades(iris):
    options = _parser().parse_args(["apply", "Scene_0001_radiance.exr", "--lens", LENS, *to_arguments(iris=iris)])
    assert iris_option(options) == (iris or Iris(0))


def test_the_command_line_requires_blades_for_iris_options():
    for field, value in ("--iris-rotation", 5.0), ("--iris-roundness", 0.5):
        with refused(InputError, field=field, value=value, match="give --iris-blades"):
            iris_option(_parser().parse_args(["apply", "Scene_0001_radiance.exr", "--lens", LENS, field, str(value)]))


@pytest.mark.parametrize("values, field, value", [
    ((2,), "blades", 2), ((-1,), "blades", -1), ((1000,), "blades", 1000), ((5, 0.0, 1.5), "roundness", 1.5),
    ((5, inf), "rotation", inf)])
def test_impossible_blades_are_rejected(values, field, value):
    with refused(InputError, field=field, value=value, where="iris"):
        Iris(*values)


def bokeh(lens, depth_mm, iris, shape_px=(54, 72)):
    """A small lamp out of focus on the axis, through a lens."""
    pitch_um = lens.sensor_mm[0] / shape_px[1] / ENLARGED * 1e3
    grid = PixelGrid.around_frame(shape_px, pitch_um, (30, 30))
    light = np.zeros((1, *grid.shape_px), np.float32)
    rows, columns = grid.shape_px
    light[0, rows // 2 - 1:rows // 2 + 1, columns // 2 - 1:columns // 2 + 1] = 1
    lamp = Layer(light, np.ones(grid.shape_px, np.float32), np.full(grid.shape_px, depth_mm, np.float32))
    layered = LayeredRadiance([lamp], [550.0], grid, lens.capture_focal_length_mm)
    return simulate(layered, lens, iris=iris).cube[0]


def cycles_bokeh(scene, lens, depth_mm, folder, corner):
    """The same by Cycles' own depth of field with the camera's blades, whose corners are on the round stop."""
    rows, columns = scene.render.resolution_y, scene.render.resolution_x
    width_mm, camera = lens.sensor_mm[0] / ENLARGED, scene.camera.data
    camera.lens = lens.capture_focal_length_mm * camera.sensor_width / width_mm
    camera.dof.aperture_fstop = camera.lens / (corner * entrance_pupil_diameter_mm(lens))
    glow = material("Glow", "ShaderNodeEmission")[0]
    wall(scene, glow, depth_mm / 1e3, 2 * width_mm / columns * depth_mm / lens.capture_focal_length_mm / 1e3)
    scene.cycles.samples, scene.cycles.pixel_filter_type = 1024, "BOX"
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGB", "32"
    scene.render.filepath = str(folder / "bokeh.exr")
    bpy.ops.render.render(write_still=True)
    (_, planes), = read_parts(folder / "bokeh.exr")
    assert planes["R"].shape == (rows, columns)
    return planes["R"]


@pytest.mark.sample(1)
@pytest.mark.parametrize("depth_mm", [700.0, 10000.0])
def test_blades_are_rotated_as_in_cycles(scene, blades, tmp_path, depth_mm):
    """In front of the focus and behind it: triangles agree, and would not if they were rotated or mirrored."""
    lens, _, _ = scene_lens(scene, LENS, "lens", "preview", focus=1500.0, f_number=11.0)
    blades.focus_distance, blades.aperture_blades, blades.aperture_rotation = 1.5, 3, radians(15)
    scene.camera.data.lensfield.iris_roundness = 0
    scene.render.resolution_x, scene.render.resolution_y = 72, 54
    iris = scene_iris(scene, LENS, f_number=11.0)  # stopped down far enough for the corners to be inside the rim
    corner = opening(iris, lens).corner
    ours, cycles = bokeh(lens, depth_mm, iris), cycles_bokeh(scene, lens, depth_mm, tmp_path, corner)

    def alike(picture):
        return np.sum(ours * picture) / np.sqrt(np.sum(ours**2) * np.sum(picture**2))

    others = cycles[::-1, ::-1], cycles[:, ::-1], cycles[::-1]
    assert alike(cycles) > 0.98 and all(alike(other) < alike(cycles) - 0.01 for other in others)
