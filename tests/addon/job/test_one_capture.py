"""Frames that differ only in focus and f-stop: one capture serves all, with the same results as separate ones."""

import os
import subprocess
import sys
from dataclasses import replace

import bpy
import numpy as np
import OpenEXR
import pytest

from lensfield import addon
from lensfield.addon.capture import slabs
from lensfield.addon.job.result import FRAME_FILES
from lensfield.addon.render.one_capture import OneCapture
from lensfield.addon.render.render import job_of_frame
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.runtime import files
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from lensfield.engine.stray.options import StrayOptions
from small_scenes import WAVELENGTHS_NM, material, set_world, wall
from snapshot import differences, snapshot
from waiting import LAST_RESORT_S

LENS = "kodak-petzval-100mm"  # from 1.05 m and f/2.14 on: nearest, it moves as a unit, and its view is 9 % narrower
FRAMES = 1, 3, 5, 7
OPTIONS = {"lens": LENS, "wavelengths_nm": WAVELENGTHS_NM, "lens_quality": "preview",
           "spectral": SpectralOptions("preview"), "to_compositor": False,
           "stray": StrayOptions("off")}  # the cells of its light depend on the margin of the capture
NEAR_M, FAR_M = 1.1, 6.0
CUT_MM, MARGIN_PX = (3000.0,), (12, 12)


def glowing(scene, name, colour, distance_m, side_m, place_m=(0, 0)):
    square = wall(scene, material(name, "ShaderNodeEmission", colour)[0], distance_m, side_m)
    square.name, square.location.x, square.location.y = name, *place_m
    return square


@pytest.fixture
def rack(scene):
    """A near and a far square in front of a blue sky: the focus moves between them, and the lens is stopped down."""
    set_world(scene, (0.2, 0.4, 0.9), 0.5)
    glowing(scene, "Near", (1, 0.2, 0.1), NEAR_M, 0.1, (0.06, 0.02))
    glowing(scene, "Far", (0.2, 1, 0.3), FAR_M, 1.0, (-0.4, 0.1))
    scene.cycles.samples = 256
    dof = scene.camera.data.dof
    dof.use_dof = True
    scene.render.image_settings.file_format = "OPEN_EXR"  # a factory scene has no colour space until then
    for frame, focus_m, f_number in zip(FRAMES, (NEAR_M, FAR_M, FAR_M, FAR_M), (5.6, 5.6, 5.6, 16.0), strict=True):
        dof.focus_distance, dof.aperture_fstop = focus_m, f_number
        dof.keyframe_insert("focus_distance", frame=frame)
        dof.keyframe_insert("aperture_fstop", frame=frame)
    scene.frame_set(1)
    return scene


@pytest.fixture
def cut(monkeypatch):
    """Cut between the squares, with the same margins for every lens, so that Cycles draws the same random numbers."""
    plan = slabs.plan_slabs
    monkeypatch.setattr(slabs, "plan_slabs", lambda *arguments, **named: replace(
        plan(*arguments, **named), needed=True, borders_mm=CUT_MM, margins_px=(MARGIN_PX,) * 2))


def irradiance(result):
    return read_exr(result.irradiance).cube.astype(np.float64)


def alpha(result):
    with OpenEXR.File(str(result.lens_image), separate_channels=True) as file:
        return file.channels()["A"].pixels


def test_one_capture_serves_all_frames(rack, captures, tmp_path):
    before = snapshot()
    animation = addon.render_animation(rack, FRAMES, output_folder=tmp_path, **OPTIONS)
    assert not differences(before, snapshot())
    assert len(captures) == 1 and list(animation.results) == list(FRAMES)
    assert animation.plan == "4 frames from one capture: only focus and f-stop change"
    assert animation.plan in animation.summary
    results = animation.results.values()
    assert len({os.stat(result.radiance).st_ino for result in results}) == 1
    assert all((tmp_path / f"unsaved_Scene_{frame:04d}_{name}").is_file()
               for frame in FRAMES for name in FRAME_FILES.values())
    near, far = (animation.results[frame].report.scene.depth.near_mm for frame in (1, 5))
    assert near < 1e3 * NEAR_M < far < 1e3 * FAR_M
    assert not addon.Animation(rack, FRAMES, output_folder=tmp_path, **OPTIONS).pending
    assert addon.Animation(rack, [1, 2], output_folder=tmp_path, **OPTIONS).pending == [2]


def test_each_frame_equals_a_separate_render(rack, cut, tmp_path):
    """In the camera's view, where all lenses use exactly the captured pixels."""
    options = OPTIONS | {"view": "camera"}
    one = addon.render_animation(rack, FRAMES, output_folder=tmp_path / "one", **options).results
    for frame in (1, 5, 7):
        alone = addon.render_through_lens(rack, frame=frame, output_folder=tmp_path / "alone", **options)
        for ours, theirs in ((irradiance(each) for each in (one[frame], alone)), map(alpha, (one[frame], alone))):
            np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=1e-5 * theirs.max())


def middle_px(red):
    """Row and column of the centroid of red light."""
    rows, columns = np.indices(red.shape)
    return np.array([np.sum(places * red) for places in (rows, columns)]) / red.sum()


def test_the_field_of_view_changes_with_focus(rack, tmp_path):
    """On its own sensor, although one pinhole captured all frames: light lands as in a separate render of the frame."""
    set_world(rack, (0, 0, 0))
    rack.objects["Far"].hide_render = True
    results = addon.render_animation(rack, FRAMES, output_folder=tmp_path / "one", **OPTIONS).results
    red = {frame: irradiance(results[frame])[-1] for frame in (1, 5)}
    near, far = (np.hypot(*(middle_px(red[frame]) - np.array([17.5, 23.5]))) for frame in (1, 5))
    assert near > 1.05 * far
    for frame, ours in red.items():
        alone = addon.render_through_lens(rack, frame=frame, output_folder=tmp_path / "alone", **OPTIONS)
        theirs = irradiance(alone)[-1]
        # Each of at most 100 pixels along the square's edges has an error of at most a half over the root of 256
        # samples. The sum of the square's 100 pixels or more then has an error of 0.3, and five times that for 5 sigma;
        # the centroid has the same relative error of its half width.
        np.testing.assert_allclose(ours.sum(), theirs.sum(), rtol=0.015)
        np.testing.assert_allclose(middle_px(ours), middle_px(theirs), atol=0.1)


def test_each_frame_reports_the_limits_of_one_depth_per_pixel(rack, tmp_path):
    """A separate render reports the same, except for the lens's own lines; and so does a frame that reuses a capture.
    """
    glowing(rack, "Pane", (1, 1, 1), 2.0, 1.0).data.materials[0] = material("Glass", "ShaderNodeBsdfGlass")[0]
    rack.render.resolution_x, rack.render.resolution_y, rack.cycles.samples = 96, 72, 4
    results = addon.render_animation(rack, FRAMES[:2], output_folder=tmp_path, **OPTIONS).results
    remarks = [result.report.scene.scene_remarks for result in results.values()]
    assert all(sum(line.startswith("Glass 'Pane'") for line in lines) == 1 for lines in remarks)
    assert remarks[0][-1] == remarks[1][-1]


def test_a_cancelled_animation_resumes_with_the_same_light(rack, captures, tmp_path):
    first = addon.Animation(rack, FRAMES, output_folder=tmp_path, **OPTIONS)
    result = first.render(1)
    rest = addon.render_animation(rack, FRAMES, output_folder=tmp_path, **OPTIONS)
    assert list(rest.results) == [3, 5, 7] and list(rest.earlier) == [1] and len(captures) == 2
    light = [read_exr(one.radiance).cube for one in (result, rest.results[7])]
    np.testing.assert_array_equal(*light)


def test_a_stopped_capture_is_repeated(rack, captures, monkeypatch, tmp_path):
    animation, before = addon.Animation(rack, FRAMES, output_folder=tmp_path, **OPTIONS), snapshot()

    def stop(fraction, label):
        if "Layer" in label:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        animation.render(1, stop)
    assert not differences(before, snapshot()) and not list(tmp_path.iterdir())
    animation.render(3)
    assert len(captures) == 2 and list(animation.results) == [3]


def test_deleted_radiance_is_written_again(rack, captures, tmp_path):
    animation = addon.Animation(rack, FRAMES, output_folder=tmp_path, **OPTIONS)
    animation.render(1).radiance.unlink()
    assert animation.render(3).radiance.is_file() and len(captures) == 1


def test_moving_objects_are_captured_frame_by_frame(rack, captures, tmp_path):
    near = rack.objects["Near"]
    for frame, x_m in ((1, 0.06), (7, 0.0)):
        near.location.x = x_m
        near.keyframe_insert("location", frame=frame)
    animation = addon.render_animation(rack, FRAMES[:2], output_folder=tmp_path, **OPTIONS)
    assert animation.plan == "each frame is captured separately: object 'Near' is animated" and not captures
    assert len({os.stat(result.radiance).st_ino for result in animation.results.values()}) == 2
    rack.camera.data.animation_data_clear()
    assert addon.Animation(rack, FRAMES, output_folder=tmp_path, **OPTIONS).plan == ""


def test_frames_with_other_settings_are_captured_separately(rack, tmp_path):
    options = OPTIONS | {"output_folder": tmp_path}
    one, job = OneCapture.of_frames(rack, FRAMES, **options), job_of_frame(rack, 3, **options)
    assert one.holds(job)
    for other in (replace(job, depth="traced"), replace(job, denoise="on"),
                  replace(job, settings=job.settings | {"samples": 3})):
        assert not one.holds(other)
    assert addon.Animation(rack, FRAMES, **options, depth="traced").plan == (
        "each frame is captured separately: the lens is traced")


def test_the_command_announces_the_single_capture_first(rack, tmp_path):
    blend = tmp_path / "rack.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    command = [sys.executable, "-c", "from lensfield.cli import console; console()", "render", str(blend),
               "--lens", LENS, "--frames", "1-3:2", "--wavelengths", "450,550,650", "--lens-quality", "preview",
               "--tier", "preview", "--output", str(tmp_path)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=LAST_RESORT_S)
    assert result.returncode == 0, result.stderr
    output, first, *_ = result.stdout.splitlines()
    assert output == f"output: {tmp_path}"
    assert first == "2 frames from one capture: only focus and f-stop change"
    assert (tmp_path / "rack_Scene_0001_radiance.exr").samefile(tmp_path / "rack_Scene_0003_radiance.exr")


def test_one_capture_supports_film_and_region(rack, cut, tmp_path):
    rack.render.film_transparent = rack.render.use_border = True
    rack.render.border_min_x, rack.render.border_max_x = 0.25, 1.0
    rack.render.border_min_y, rack.render.border_max_y = 0.0, 0.75
    options = OPTIONS | {"view": "camera"}
    one = addon.render_animation(rack, (1, 5), output_folder=tmp_path / "one", **options).results[5]
    alone = addon.render_through_lens(rack, frame=5, output_folder=tmp_path / "alone", **options)
    ours, theirs = map(alpha, (one, alone))
    np.testing.assert_array_equal(ours == 0, theirs == 0)
    assert 0.05 < theirs.mean() < 0.6
    np.testing.assert_allclose(ours, theirs, atol=1e-4)
    np.testing.assert_allclose(irradiance(one), irradiance(alone), rtol=1e-4, atol=1e-5 * irradiance(alone).max())


def test_a_file_is_copied_where_hard_links_are_refused(tmp_path, monkeypatch):
    source, other = tmp_path / "one", tmp_path / "other"
    source.write_text("light")
    files.link_or_copy(source, other)
    files.link_or_copy(source, other)  # it already is one
    assert other.samefile(source) and other.read_text() == "light"

    def refuse(*_):
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", refuse)
    other.unlink()
    files.link_or_copy(source, other)
    assert not other.samefile(source) and other.read_text() == "light"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one", "other"]
