"""Datasets: one capture of each frame serves all lenses, each picture equals a render, and the index lists them."""

import json
import subprocess
import sys
from dataclasses import replace

import bpy
import numpy as np
import pytest
from PIL import Image

from lensfield import addon
from lensfield.addon.render import dataset as dataset_module
from lensfield.addon.render.animation import Animation
from lensfield.addon.render.dataset_index import INDEX, line_path
from lensfield.addon.render.dataset_pairs import exact_sum
from lensfield.engine import Options, load_lens
from lensfield.engine.calibration.formats import FORMATS, calibrated_for
from lensfield.engine.calibration.stored import calibration_from
from lensfield.engine.calibration.views import View
from lensfield.engine.inspection.curves import reference_nm
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.pictures.preview import to_rec709
from lensfield.engine.pictures.spectral_exr import read_exr, read_parts
from lensfield.engine.plan.options import TIER_ACCURACY
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.locks import only_writer
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from lensfield.engine.stray.options import StrayOptions
from noise import assert_means
from refusals import refused
from small_scenes import WAVELENGTHS_NM, material, wall
from snapshot import differences, snapshot
from waiting import LAST_RESORT_S

SHARP, FAST, ANAMORPHIC, FISHEYE = "tessar-50mm", "angenieux-50mm", "cooke-42mm-2x", "muller-fisheye-25mm"
FOLDERS = [f"{lens}_f{f_number}" for lens in (FAST, SHARP) for f_number in ("5.6", "8")]
QUICK = {"wavelengths_nm": WAVELENGTHS_NM, "spectral": SpectralOptions("preview"),
         "options": Options(accuracy=TIER_ACCURACY["preview"])}
TRUTH = "depth,index"


@pytest.fixture
def ball(scene, tmp_path):
    """A saved scene in units of 10 cm: a small glowing square moves in front of a large one. The camera is shifted, and
    focuses on the large square."""
    scene.unit_settings.scale_length = 0.1
    wall(scene, material("Far", "ShaderNodeEmission", (0.7, 0.3, 0.2))[0], 40.0, 100.0).pass_index = 3
    near = wall(scene, material("Near", "ShaderNodeEmission", (0.2, 0.5, 2.0))[0], 10.0, 1.5)
    near.name, near.pass_index = "Near", 7
    for frame, x in ((1, 0.9), (2, -0.4)):
        near.location.x, near.location.y = x, 0.6
        near.keyframe_insert("location", frame=frame)
    scene.camera.data.shift_x, scene.camera.data.lens = 0.05, 40
    dof = scene.camera.data.dof
    dof.use_dof, dof.focus_distance = True, 40.0
    scene.frame_start, scene.frame_end = 1, 2
    scene.frame_set(1)
    scene.render.image_settings.file_format = "OPEN_EXR"  # a factory scene has no colour space until then
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "ball.blend"))
    return scene


def dataset(scene, folder, lenses=(SHARP, FAST), f_numbers=(5.6, 8), frames=(1, 2), **given):
    return addon.Dataset(scene, lenses, f_numbers, frames, output_folder=folder, **QUICK | given)


def rendered(*arguments, **given):
    planned = dataset(*arguments, **given)
    return [result for turn in planned.turns for result in planned.render(turn)]


def lines(folder):
    return [json.loads(line) for line in (folder / INDEX).read_text(encoding="utf-8").splitlines()]


def stamps(folder):
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*_lens_image.exr")}


def test_one_capture_of_each_frame_serves_all_lenses(ball, captures, tmp_path):
    folder, before = tmp_path / "set", snapshot()
    results = rendered(ball, folder, truth=TRUTH, formats=["opencv", "nerfstudio"])
    assert not differences(before, snapshot())
    assert captures == [1, 2] and len(results) == 8
    assert sorted(path.name for path in folder.iterdir()) == sorted([*FOLDERS, INDEX])
    index = lines(folder)
    assert [(line["files"]["lens_image"], line["frame"]) for line in index] == [
        (f"{name}/ball_Scene_{frame:04d}_lens_image.exr", frame) for name in FOLDERS for frame in (1, 2)]
    assert [(line["lens"], line["f_number"]) for line in index[::2]] == [
        (FAST, 5.6), (FAST, 8), (SHARP, 5.6), (SHARP, 8)]
    for line in index:
        assert all((folder / file).is_file() for file in line["files"].values())
        assert line["size_px"] == [48, 36] and line["wavelengths_nm"] == list(WAVELENGTHS_NM)
        assert line["truth"] == TRUTH.split(",") and "ViewLayer.Depth.Z" in line["truth_channels"]
        assert line["focus_mm"] == pytest.approx(4000)
        assert (line["samples"], line["seed"]) == (ball.cycles.samples, ball.cycles.seed)
    first = stamps(folder), (folder / INDEX).read_bytes()
    assert not rendered(ball, folder, truth=TRUTH, formats=["opencv", "nerfstudio"])
    assert (stamps(folder), (folder / INDEX).read_bytes()) == first


@pytest.mark.parametrize("lens", [FAST, SHARP])
def test_each_picture_and_its_truth_are_those_of_a_render(ball, tmp_path, lens):
    ball.cycles.samples = 256
    rendered(ball, tmp_path / "set", truth=TRUTH, frames=[2])
    alone = addon.render_through_lens(ball, frame=2, lens=lens, f_number=5.6, view="camera", truth=TRUTH,
                                      output_folder=tmp_path / "alone", **QUICK)
    folder = tmp_path / "set" / f"{lens}_f5.6"
    pixels, expected = (read_exr(path / alone.irradiance.name).cube.reshape(3, 3, 12, 4, 12).transpose(0, 1, 3, 2, 4)
                        for path in (folder, alone.irradiance.parent))
    assert_means(pixels, expected, rtol=0.01, noise=0.03)
    ours, theirs = (read_parts(path / alone.truth.name)[0][1] for path in (folder, alone.truth.parent))
    assert ours.keys() == theirs.keys()
    for channel in ours:  # the middles of pixels are at the same places in all captures of the camera's view
        np.testing.assert_allclose(ours[channel], theirs[channel], rtol=1e-4)


def test_calibrations_agree_with_the_camera_of_each_frame(ball, tmp_path):
    """Also after a later run has added a format."""
    rendered(ball, tmp_path / "set", [SHARP], [8], formats=["opencv"])
    earlier = stamps(tmp_path / "set")
    rendered(ball, tmp_path / "set", [SHARP], [8], formats=["nerfstudio"])
    assert stamps(tmp_path / "set") == earlier
    folder = tmp_path / "set" / f"{SHARP}_f8"
    camera = addon.frame_camera(ball, 2, lens=SHARP, f_number=8.0, view="camera", **QUICK)
    expected = calibrated_for("opencv", camera.lens, camera.grid, reference_nm(camera.lens))
    line = lines(tmp_path / "set")[1]
    assert calibration_from(line["calibration"]["opencv"]) == expected
    assert (folder / "ball_Scene_0002_opencv.yml").read_text() == FORMATS["opencv"].text([View(expected)])
    cameras = json.loads((folder / "ball_Scene_nerfstudio.json").read_text())
    assert [frame["file_path"] for frame in cameras["frames"]] == [f"ball_Scene_{frame:04d}_after.png"
                                                                   for frame in (1, 2)]
    np.testing.assert_allclose(cameras["frames"][1]["transform_matrix"], camera.pose)
    np.testing.assert_allclose(line["pose"], camera.pose)


def test_all_cameras_of_a_file_are_of_one_kind(ball, captures, tmp_path):
    """Of a zoom whose frames are fisheyes or not, also in several runs; unless other frames cannot be written again."""
    data = ball.camera.data
    data.shift_x = 0
    for frame, focal_mm in ((1, 60), (2, 14)):
        data.lens = focal_mm
        data.keyframe_insert("lens", frame=frame)
    ball.frame_set(1)
    given = {"formats": ["nerfstudio"], "lenses": [FISHEYE], "f_numbers": []}

    def kinds(folder):
        return [line["calibration"]["nerfstudio"]["model"] for line in lines(folder)]

    rendered(ball, tmp_path / "a", **given | {"frames": [1]})
    assert kinds(tmp_path / "a") != ["kannala-brandt"]
    with refused(InputError, field="calibration", match="unlike frame 1"):
        dataset(ball, tmp_path / "a", **given | {"frames": [2]})
    for frames in ([1, 2], [1]):
        rendered(ball, tmp_path / "a", **given | {"frames": frames})
        assert kinds(tmp_path / "a") == 2 * ["kannala-brandt"]
    cameras = json.loads(next(tmp_path.rglob("*_nerfstudio.json")).read_text())
    assert cameras["camera_model"] == "OPENCV_FISHEYE" and len(cameras["frames"]) == 2
    rendered(ball, tmp_path / "b", **given | {"frames": [2]})
    rendered(ball, tmp_path / "b", **given | {"frames": [1]})
    assert kinds(tmp_path / "b") == 2 * ["kannala-brandt"] and captures == [1, 2, 2, 1]


def test_frames_are_visited_once_for_all_lenses(ball, tmp_path):
    """To find the models of a file with the cameras of all frames."""
    def visits(lenses, formats):
        visited = []
        bpy.app.handlers.frame_change_post.append(lambda scene, _: visited.append(scene.frame_current))
        dataset(ball, tmp_path / "set", lenses, [8], formats=formats)
        bpy.app.handlers.frame_change_post.pop()
        return visited.count(2)

    one, two = (visits(lenses, ["nerfstudio"]) - visits(lenses, []) for lenses in ([SHARP], [SHARP, FAST]))
    assert one == two == 1


def test_texts_of_calibrations_are_made_once(ball, captures, tmp_path, monkeypatch):
    planned, made, form = dataset(ball, tmp_path, [SHARP], [8], formats=["opencv"]), [], FORMATS["opencv"]
    monkeypatch.setitem(FORMATS, "opencv", replace(form, text=lambda views: made.append(views) or form.text(views)))
    results = [result for turn in planned.turns for result in planned.render(turn)]
    assert len(made) == len(results) == 2


def test_a_stopped_run_resumes(ball, captures, tmp_path, monkeypatch):
    """After the third picture, before the lines of its frame; and without the index."""
    folder, count, render = tmp_path / "set", 0, Animation.render

    def stopping(animation, *arguments):
        nonlocal count
        count += 1
        if count == 4:
            raise KeyboardInterrupt
        return render(animation, *arguments)

    monkeypatch.setattr(Animation, "render", stopping)
    with pytest.raises(KeyboardInterrupt):
        rendered(ball, folder)
    monkeypatch.undo()
    earlier = stamps(folder)
    assert len(earlier) == 3 and not list(folder.rglob("*_picture.json"))
    assert len(rendered(ball, folder)) == 5
    assert stamps(folder).items() >= earlier.items() and len(lines(folder)) == 8
    (folder / INDEX).unlink()
    assert not rendered(ball, folder) and len(lines(folder)) == 8
    assert [path.name for path in folder.iterdir() if path.name.startswith(".")] == []


@pytest.mark.parametrize("least_s, count", [(0, 3), (1e9, 2)])
def test_the_index_is_written_now_and_then_and_at_the_end(ball, captures, tmp_path, monkeypatch, least_s, count):
    counts, write = [], dataset_module.write_index
    monkeypatch.setattr(dataset_module, "INDEX_S", least_s)
    monkeypatch.setattr(dataset_module, "write_index", lambda folder: counts.append(write(folder)))
    rendered(ball, tmp_path, [SHARP], [8])
    assert len(counts) == count and len(lines(tmp_path)) == 2


def test_runs_of_other_frames_and_lenses_share_the_index(ball, captures, tmp_path):
    rendered(ball, tmp_path, [SHARP], [8], frames=[2])
    rendered(ball, tmp_path, [FAST], [8], frames=[1])
    assert [(line["lens"], line["frame"]) for line in lines(tmp_path)] == [(FAST, 1), (SHARP, 2)]
    rendered(ball, tmp_path, [SHARP, FAST], [8])
    assert captures == [2, 1, 1, 2] and len(lines(tmp_path)) == 4
    assert len(rendered(ball, tmp_path, [SHARP], [8], frames=[1], truth="index")) == 1  # other settings
    assert [line["truth"] for line in lines(tmp_path)] == [[], [], ["index"], []]


def test_one_capture_serves_all_frames_of_a_focus_pull(ball, captures, tmp_path):
    ball.objects["Near"].animation_data_clear()
    dof = ball.camera.data.dof
    for frame, distance in ((1, 10.0), (2, 40.0)):
        dof.focus_distance, dof.aperture_fstop = distance, 4.0 * frame
        dof.keyframe_insert("focus_distance", frame=frame)
        dof.keyframe_insert("aperture_fstop", frame=frame)
    rendered(ball, tmp_path, [FAST], ())
    index = lines(tmp_path)
    assert len(captures) == 1 and [line["files"]["record"].split("/")[0] for line in index] == [FAST] * 2
    np.testing.assert_allclose([line["focus_mm"] for line in index], [1000, 4000])
    np.testing.assert_allclose([line["f_number"] for line in index], [4, 8])


def test_lenses_of_each_squeeze_have_a_capture(ball, captures, tmp_path):
    results = rendered(ball, tmp_path, [SHARP, ANAMORPHIC], [8], frames=[1], truth=TRUTH, formats=["opencv"])
    assert captures == [1, 1] and len(results) == 2
    squeezed, plain = lines(tmp_path)
    assert (plain["size_px"], plain["squeeze"]) == ([48, 36], 1)
    assert (squeezed["size_px"], squeezed["squeeze"]) == ([24, 36], pytest.approx(1.98, abs=0.01))
    across, down = squeezed["calibration"]["opencv"]["focal_px"]
    assert down / across == pytest.approx(squeezed["squeeze"], rel=0.03)
    indices = read_parts(tmp_path / squeezed["files"]["truth"])[0][1]["ViewLayer.Object Index.X"]
    assert indices.shape == (36, 24) and set(np.unique(indices)) == {3, 7}


def test_each_lens_has_its_own_remarks(ball, tmp_path):
    """None is about the lens that the capture was planned for."""
    ball.render.resolution_x, ball.render.resolution_y, ball.cycles.samples = 192, 144, 1
    ball.camera.data.dof.focus_distance = 10.0
    write_package(replace(load_lens("edmund-54852"), name="Edmund"), tmp_path / "plain.npz")
    made = addon.render_dataset(ball, [FAST, str(tmp_path / "plain.npz")], frames=[1], output_folder=tmp_path / "set",
                                **QUICK)
    remark, = (line for line in made.messages if "a package without rays" in line)
    assert remark.startswith("plain: Lens Edmund, scaled by ")
    in_focus = [line.partition("; ")[0] for line in made.messages if ": In focus: " in line]
    assert len(in_focus) == len({line.partition(": ")[2] for line in in_focus}) == 2


@pytest.mark.parametrize("given, field, match", [
    ({"lenses": ["tessar-50mm"], "f_numbers": [2]}, "f-number", "tessar-50mm has f/5.5 to f/22"),
    ({"lenses": ["no-lens"]}, "lens", None),
    ({"lenses": []}, "lenses", "give one or more"),
    ({"frames": []}, "frames", "give one or more"),
    ({"lens": SHARP}, "lens", "give lenses"),
    ({"f_numbers": (), "f_number": 8.0}, "f_number", "give f_numbers"),
    ({"view": "lens"}, "view", "the view of the scene's camera"),
    ({"lenses": [SHARP, SHARP]}, "lens", "a second folder tessar-50mm_f5.6"),
    ({"depth": "traced"}, "depth", "a traced lens captures no light for other lenses"),
    ({"lenses": [ANAMORPHIC], "f_numbers": [8], "formats": ["lensfun"]}, "calibration", "is anamorphic"),
    ({"formats": ["opencv", "lensfun"]}, "calibration", "set the camera's Shift and Tilt to 0"),
    ({"truth": "flow", "frames": [1]}, "motion", None)])
def test_bad_input_is_refused_before_the_render(ball, captures, tmp_path, given, field, match):
    if given.get("truth"):
        ball.frame_end = 1
        ball.objects["Near"].animation_data_clear()
    with refused(InputError, field=field, match=match):
        dataset(ball, tmp_path / "set", **given)
    assert not captures and not (tmp_path / "set" / INDEX).exists()


def test_processes_share_the_captures(ball, tmp_path):
    ball.cycles.samples = 64
    blend, folder = tmp_path / "ball.blend", tmp_path / "set"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    command = [sys.executable, "-c", "from lensfield.cli import console; console()", "dataset", str(blend), "--lens",
               f"{SHARP},{FAST}", "--f-number", "5.6,8", "--frames", "scene", "--wavelengths", "450,550,650",
               "--tier", "preview", "--output", str(folder), "--wait"]
    processes = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
                 for _ in range(2)]
    outputs = [process.communicate(timeout=LAST_RESORT_S) for process in processes]
    assert not any(process.returncode for process in processes), outputs
    pictures = [line for output, _ in outputs for line in output.splitlines() if line.endswith("_lens_image.exr")]
    assert len(pictures) == len(set(pictures)) == len(lines(folder)) == 8
    assert not (folder / ".lensfield").exists()


def planes(path):
    return np.stack([read_parts(path)[0][1][channel] for channel in "RGB"], axis=-1)


def test_pairs_of_flare_add_up_to_the_last_bit(ball, captures, tmp_path):
    """Of any exposure, and also if they are requested after the pictures."""
    ball.cycles.film_exposure = 3.7
    given = {"stray": StrayOptions("veil", cleanliness="hazy"), "frames": [1], "look": "standard"}
    rendered(ball, tmp_path, [SHARP], [8], **given)
    assert not rendered(ball, tmp_path, [SHARP], [8], **given, pairs="flare") and captures == [1]
    line, = lines(tmp_path)
    files = {name: tmp_path / path for name, path in line["pairs"]["flare"].items()}
    flared, clean, flare = (planes(files[f"linear_{name}"]) for name in ("input", "gt", "flare"))
    assert {picture.dtype for picture in (flared, clean, flare)} == {np.dtype(np.float32)}
    assert np.array_equal(clean + flare, flared) and flare.min() > 0 and clean.max() > 100 * flare.mean()
    picture = to_rec709(read_exr(tmp_path / line["files"]["irradiance"]))
    np.testing.assert_allclose(flared, picture, rtol=0, atol=np.finfo(np.float32).eps * picture.max())
    pngs = [np.asarray(Image.open(files[name])) for name in ("input", "gt", "flare")]
    assert {png.shape for png in pngs} == {(36, 48, 3)} and np.all(pngs[0] >= pngs[1])
    assert [path.relative_to(tmp_path).parts[:2] for path in files.values()][::2] == [
        ("pairs", "input"), ("pairs", "gt"), ("pairs", "flare")]


def test_sums_are_exact_for_all_magnitudes():
    random = np.random.default_rng(3)
    flare = np.float32(10) ** random.uniform(-9, 3, (200, 300)).astype(np.float32)
    given = flare * random.uniform(1, 1e6, flare.shape).astype(np.float32)
    flared, clean, same = exact_sum(given, flare)
    assert np.array_equal(clean + same, flared) and np.array_equal(same, flare)
    np.testing.assert_allclose(flared, given, rtol=1.2e-7)


def test_pairs_of_bokeh_have_the_layout_of_realbokeh(ball, captures, tmp_path):
    """One sharp picture, and the blurred ones, equally bright; and metadata with paths from the split's folder."""
    rendered(ball, tmp_path, [FAST], [1.4, 4, 16], frames=[2], pairs="bokeh", look="standard")
    assert captures == [2]
    split = tmp_path / "pairs" / "train"
    metadata = json.loads((split / "metadata" / f"{FAST}_ball_Scene_0002.json").read_text())
    assert (metadata["source_av"], metadata["target_avs"]) == (16, [4, 1.4])
    sharp, *blurred = (np.asarray(Image.open(split / name), float)
                       for name in (metadata["source_image"], *metadata["target_images"]))
    for picture in blurred:
        assert picture.shape == (36, 48, 3)
        middle = slice(14, 28), slice(16, 32)  # without vignetting
        np.testing.assert_allclose(np.median(picture[middle]), np.median(sharp[middle]), rtol=0.03)
    edges = [np.abs(np.diff(picture, axis=1)).max() for picture in (sharp, *blurred)]
    assert edges[0] > edges[2]
    assert all("bokeh" in line["pairs"] for line in lines(tmp_path))


def test_pictures_of_another_state_of_the_scene_get_no_present_pose(ball, captures, tmp_path):
    """Neither with a further f-number, format and pairs, nor if their lines are missing; until they are overwritten."""
    rendered(ball, tmp_path, [FAST], [5.6, 8], frames=[1], formats=["opencv"])
    earlier = lines(tmp_path)
    next(tmp_path.rglob("*_f8/*_picture.json")).unlink()
    ball.camera.location.x += 0.1
    given = {"f_numbers": [5.6, 8, 16], "frames": [1], "formats": ["opencv", "nerfstudio"], "pairs": "bokeh"}
    later = addon.render_dataset(ball, [FAST], output_folder=tmp_path, **QUICK, **given)
    current, kept = lines(tmp_path)
    assert kept == earlier[0] and current["f_number"] == 16 and not current["pairs"]
    assert current["pose"] != kept["pose"] and not (tmp_path / "pairs").exists()
    message, = (line for line in later.messages if line.startswith("without a line"))
    assert "3 of the pictures, from frame 1 on" in message and "--overwrite" in message
    rendered(ball, tmp_path, [FAST], overwrite=True, **given)
    index = lines(tmp_path)
    assert {str(line["pose"]) for line in index} == {str(current["pose"])}
    assert len(index) == 3 and all("bokeh" in line["pairs"] for line in index)


def test_earlier_pictures_that_another_process_renders_are_left_to_it(ball, captures, tmp_path):
    result, = rendered(ball, tmp_path, [FAST], [8], frames=[1])
    line = line_path(result)
    line.unlink()
    planned = dataset(ball, tmp_path, [FAST], [8], frames=[1])
    with only_writer(planned._lock((1.0, 1))):
        assert not list(planned.turns)
    assert not line.exists()
    planned = dataset(ball, tmp_path, [FAST], [8], frames=[1])
    result.record.unlink()
    assert not list(planned.turns) and not line.exists() and not lines(tmp_path)


def test_lines_of_pictures_that_another_process_has_rendered_stay(ball, captures, tmp_path):
    """Also if this process was to render them; a render of its own replaces the line."""
    planned = dataset(ball, tmp_path, [FAST], [8], frames=[1])
    result, = rendered(ball, tmp_path, [FAST], [8], frames=[1])
    line_path(result).write_text(line_path(result).read_text().replace('"lensfield-dataset"', '"other"'))
    assert not [each for turn in planned.turns for each in planned.render(turn)]
    assert lines(tmp_path)[0]["format"] == "other"
    assert rendered(ball, tmp_path, [FAST], [8], frames=[1], overwrite=True)
    assert lines(tmp_path)[0]["format"] == "lensfield-dataset"


@pytest.mark.parametrize("damage", [
    {"files": {"lens_image": "a.exr"}}, {"files": None}, {"frame": None}, {"pairs": []}, {"pose": [[1, 0], [0, 1]]},
    {"calibration": {"opencv": {"model": "none"}}}, {"version": 0}])
def test_damaged_lines_are_written_again(ball, captures, tmp_path, damage):
    rendered(ball, tmp_path, [FAST], [8], frames=[1])
    path = next(tmp_path.rglob("*_picture.json"))
    path.write_text(json.dumps(json.loads(path.read_text()) | damage))
    assert not rendered(ball, tmp_path, [FAST], [8], frames=[1])
    line, = lines(tmp_path)
    assert line["pose"] and captures == [1]


def test_pairs_of_bokeh_follow_the_f_numbers(ball, captures, tmp_path):
    """A further f-number becomes the sharp one; f-numbers of another run take the place of the earlier ones."""
    def pictures():
        return {(path.parent.name, path.name.removeprefix(f"{FAST}_").removesuffix("_ball_Scene_0001.png"))
                for path in (tmp_path / "pairs").rglob("*.png")}

    for f_numbers in ([5.6, 8], [5.6, 8, 16]):
        rendered(ball, tmp_path, [FAST], f_numbers, frames=[1], pairs="bokeh")
    assert pictures() == {("in", "f16"), ("gt", "f8"), ("gt", "f5.6")}
    pairs, = {json.dumps(line["pairs"]) for line in lines(tmp_path)}
    files = json.loads(pairs)["bokeh"]
    assert files.keys() == {"metadata", "f5.6", "f8", "f16"}
    assert all((tmp_path / file).is_file() for file in files.values())
    rendered(ball, tmp_path, [FAST], [4, 5.6], frames=[1], pairs="bokeh")
    assert pictures() == {("in", "f5.6"), ("gt", "f4")}
    assert {line["f_number"] for line in lines(tmp_path) if line["pairs"]} == {4, 5.6}


@pytest.mark.parametrize("given, field", [
    ({"pairs": "flare", "stray": StrayOptions("off")}, "stray"),
    ({"pairs": "flare", "stray": StrayOptions("ghosts"), "coating": "ideal"}, "stray"),
    ({"pairs": "flare", "stray": StrayOptions("veil"), "files": "pictures"}, "files"),
    ({"pairs": "bokeh", "f_numbers": [8]}, "f-number"), ({"pairs": "bokeh", "depth": "off"}, "depth")])
def test_impossible_pairs_are_refused(ball, tmp_path, given, field):
    with refused(InputError, field=field):
        dataset(ball, tmp_path, [SHARP], **{"f_numbers": [5.6, 8]} | given)
