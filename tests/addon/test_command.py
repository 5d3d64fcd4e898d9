"""The command line, as a user calls it: in a separate process."""

import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

import lensfield as extension
from lens_texts import DOT_LENS
from lensfield import addon, cli
from lensfield.addon.job.job import job_of
from lensfield.addon.job.recorded import recorded_fields
from lensfield.addon.job.result import FRAME_FILES, LENS_FILES
from lensfield.cli import main
from lensfield.engine import ReadingOptions, read_prescription
from lensfield.engine.library import BUNDLED
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.runtime.messages import read_message
from places import SAMPLE_SCENE
from signalled import heed_hangups, signalled
from small_scenes import adjust, light, material, set_world, wall
from waiting import LAST_RESORT_S, wait_until


@pytest.fixture
def blend(scene, tmp_path):
    set_world(scene)
    path = tmp_path / "scene with space.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def lensfield(*arguments):
    command = [sys.executable, "-c", "from lensfield.cli import console; console()", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=LAST_RESORT_S)


def test_a_scene_is_chosen_by_its_name(blend, capfd):
    bpy.ops.scene.new(type="LINK_COPY")
    bpy.context.scene.name, bpy.context.scene.camera = "Night", None
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    assert main(["lint", str(blend), "--scene-name", "Scene"]) == 0
    assert main(["lint", str(blend), "--scene-name", "Night"]) == 1
    assert "scene 'Night': camera is missing" in capfd.readouterr().out
    assert main(["lint", str(blend), "--scene-name", "Day"]) == 1
    assert f"{blend}: scene is Day: not in the file; its scenes: Night, Scene" in capfd.readouterr().err


def test_rendering_runs_no_scripts_of_the_scene(blend, tmp_path):
    """Its lens file is still read, because rendering a scene implies its lens."""
    script, ran = bpy.data.texts.new("stranger.py"), tmp_path / "ran"
    script.write(f"open({str(ran)!r}, 'w').close()")
    script.use_module = True
    shutil.copy(BUNDLED / "edmund-54852.npz", tmp_path / "lens.npz")
    adjust(bpy.context.scene, lens="FILE", lens_file="//lens.npz")
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    completed = lensfield("lint", blend)
    assert "refused" not in completed.stdout and completed.returncode == 0, completed.stderr
    assert not ran.exists()


def test_options_for_reading_a_file_apply_to_the_lens_of_the_scene(blend, tmp_path, capfd):
    (tmp_path / "lens.lens").write_text(DOT_LENS)
    adjust(bpy.context.scene, lens="FILE", lens_file="//lens.lens")
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    quick = ["lint", str(blend), "--tier", "preview", "--wavelengths", "550"]
    assert main(quick) == 1
    assert main([*quick, "--field-height", "12"]) == 0
    assert main([*quick, "--lens", "tessar-50mm", "--field-height", "12"]) == 1
    assert "tessar-50mm: --field-height is 12.0: applies to prescription files only" in capfd.readouterr().err


def test_frames_of_a_lens_read_with_another_field_are_rendered_again(scene, tmp_path):
    path = tmp_path / "lens.lens"
    path.write_text(DOT_LENS)
    wide, narrow = (read_prescription(path, ReadingOptions(("image_height_mm", height_mm))) for height_mm in (12, 9))
    first, again, other = (recorded_fields(job_of(scene, lens=lens, lens_quality="preview", wavelengths_nm=(550.0,)))
                           for lens in (wide, replace(wide), narrow))
    assert first == again != other


def test_render_then_filter_agree(blend, tmp_path):
    out = tmp_path / "out put"
    completed = lensfield("render", blend, "--lens", "edmund-54852", "--wavelengths", "450:650:3", "--section-size", 16,
                          "--frames", 2, "--output", out, "--report", tmp_path / "report.json")
    assert completed.returncode == 0, completed.stderr
    printed = [Path(line) for line in completed.stdout.splitlines() if line.startswith(str(out))]
    assert len(printed) == len(FRAME_FILES | LENS_FILES) and all(path.is_file() for path in printed)
    output, scene, plan = completed.stdout.splitlines()[:3]
    assert output == f"output: {out}"
    assert scene == "scene: 1 Cycles render at 550 nm: all surfaces are grey"
    assert plan.startswith("plan: 16 px sections between 32 azimuths, ")
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["stages_s"]["multispectral render"] > 0
    frame, = report["frames"]
    assert frame["frame"] == 2 and frame["plan"]["section_size"] == 16 and frame["passes"] == 1
    assert frame["energy"]["out_w_per_nm"] == pytest.approx(frame["energy"]["in_w_per_nm"], rel=1e-12)

    radiance = out / "scene_with_space_Scene_0002_radiance.exr"
    completed = lensfield("filter", radiance, "--lens", "edmund-54852", "--section-size", 16, "--stray", "off",
                          "--output", tmp_path / "again.exr", "--preview", tmp_path / "again.png")
    assert completed.returncode == 0, completed.stderr
    assert completed.stdout.splitlines()[0] == plan
    again, first = read_exr(tmp_path / "again.exr"), read_exr(out / "scene_with_space_Scene_0002_irradiance.exr")
    assert np.array_equal(again.cube, first.cube)
    assert (tmp_path / "again.png").read_bytes().startswith(b"\x89PNG")


def test_the_command_line_defaults_to_the_scenes_settings(scene, tmp_path):
    light(scene, "POINT", 20.0, color=(1, 0.5, 0.2))
    wall(scene, material("Paint", "ShaderNodeBsdfDiffuse", (0.7, 0.3, 0.05))[0])
    adjust(scene, lens="nikkor-28mm", wavelength_mode="LIST", wavelength_list="480, 530, 640", tier="RESULT",
           quality="KNOBS", method="PAPER", section_size=8, view="CAMERA", output_folder="//pictures")
    blend = tmp_path / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    assert bpy.ops.lensfield.render() == {"FINISHED"}
    expected = read_exr(tmp_path / "pictures" / "scene_Scene_0001_irradiance.exr")
    completed = lensfield("render", blend, "--output", tmp_path / "same")
    assert completed.returncode == 0, completed.stderr
    same = read_exr(tmp_path / "same" / "scene_Scene_0001_irradiance.exr")
    assert np.array_equal(same.cube, expected.cube) and same.grid == expected.grid
    completed = lensfield("render", blend, "--wavelengths", "480,640", "--accuracy", "0.1", "--report",
                          tmp_path / "report.json")
    assert completed.returncode == 0, completed.stderr
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["rendered_nm"] == [480, 640] and report["plan"]["method"] != "paper"
    assert not np.array_equal(read_exr(tmp_path / "pictures" / "scene_Scene_0001_irradiance.exr").cube, expected.cube)


def test_a_copy_elsewhere_finds_files_next_to_the_original(scene, tmp_path):
    """A spectrum, a user's lens, and the folder for the pictures."""
    set_world(scene)
    scene.world.lensfield.emission = "green.txt"
    (tmp_path / "green.txt").write_text("400 0\n500 0\n540 1\n560 1\n600 0\n700 0\n")
    shutil.copy(BUNDLED / "edmund-54852.npz", tmp_path / "own.npz")
    lamp = light(scene, "POINT", 1.0).data
    lamp.lensfield.emission = "led-b3"
    scene.camera.data.lensfield.lens, scene.camera.data.lensfield.lens_file = "FILE", "//own.npz"
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(elsewhere / "copy.blend"))
    arguments = "render", elsewhere / "copy.blend", "--wavelengths", "450,550"
    completed = lensfield(*arguments)
    assert completed.returncode == 1 and "own.npz: lens is missing" in completed.stderr
    completed = lensfield(*arguments, "--blend-folder", tmp_path)
    assert completed.returncode == 0, completed.stderr
    cube = read_exr(tmp_path / "lensfield" / "copy_Scene_0001_irradiance.exr").cube
    assert cube[1].min() > 100 * cube[0].max()
    assert [path.name for path in elsewhere.iterdir()] == ["copy.blend"]


@pytest.mark.parametrize("changes, message", [
    ({"scene": "missing.blend"}, "missing.blend: scene is missing"),
    ({"scene": "garbage.blend"}, "garbage.blend: scene is not readable"),
    ({"--lens": "no-such-lens"}, "no-such-lens: lens is missing: give a lens package, a prescription or the name"),
    ({"--wavelengths": "700:400:3"}, "options: wavelengths is 700:400:3: expected first:last:number"),
    ({"--wavelengths": "300:700:3"}, "edmund-54852: wavelength is 300 nm: the lens data spans 400 to 700 nm"),
    ({"--section-size": "0"}, "options: section_size is 0: expected a whole number"),
    ({"--resolution": "big"}, "options: --resolution is big: expected WIDTHxHEIGHT"),
    ({"--samples": "0"}, "options: --samples is 0: expected 1 to 16777216"),
    ({"--samples": "99999999999"}, "options: --samples is 99999999999: expected 1 to 16777216"),
    ({"--frames": "99999999999"}, "options: --frames is 99999999999: expected -1048574 to 1048574"),
    ({"--focus": "1.2"}, "options: --focus is 1.2: expected a distance with its unit, such as 1.2m, or inf"),
    ({"--frames": "5-1"}, "options: --frames is 5-1: expected a range such as 1-50"),
    ({"--resolution": "99999999999x24"}, "options: --resolution is 99999999999x24: expected WIDTHxHEIGHT")])
def test_bad_input_prints_one_line_and_leaves_no_files(blend, tmp_path, capsys, monkeypatch, changes, message):
    monkeypatch.chdir(tmp_path)
    Path("garbage.blend").write_bytes(b"not a blend file")
    arguments = {"--lens": "edmund-54852", "--wavelengths": "550", "--output": "out"} | changes
    scene = arguments.pop("scene", str(blend))
    assert cli.main(["render", scene, *(word for pair in arguments.items() for word in pair)]) == 1
    printed = capsys.readouterr().err
    assert message in printed and printed.count("\n") == 1
    assert not Path("out").exists() or not list(Path("out").iterdir())


def processor_s(process):
    """Processor seconds that a process has used so far: user and system."""
    figures = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(figures[11]) + int(figures[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.sample(1)
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems state processor time elsewhere")
@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_stopped_render_leaves_only_its_depth_samples(blend, tmp_path, stop):
    """During a Cycles pass that would take minutes."""
    temporary, passes = tmp_path / "temporary", tmp_path / "out" / ".lensfield" / "scene_with_space_Scene_0001_passes"
    temporary.mkdir()
    process = subprocess.Popen(
        [sys.executable, "-c", "from lensfield.cli import console; console()", "render", str(blend), "--lens",
         "edmund-54852", "--wavelengths", "550", "--resolution", "2000x2000", "--samples", "100000",
         "--output", str(tmp_path / "out")], stderr=subprocess.PIPE, text=True, preexec_fn=heed_hangups,
        env=os.environ | {"TMPDIR": str(temporary)})
    try:
        wait_until(lambda: list(passes.glob("*/[!.]*")))  # the depth samples; the pass comes next
        begin_s = processor_s(process)
        wait_until(lambda: processor_s(process) > begin_s + 1)
        process.send_signal(stop)
        assert process.wait(LAST_RESORT_S) == 130
    finally:
        process.kill()
    assert process.stderr.read().strip() == f"lensfield: cancelled; finished passes are stored in {passes}"
    left = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert not list(temporary.iterdir()) and [path.parents[1] for path in left] == [passes]


@pytest.mark.sample(3)
@pytest.mark.parametrize("stop", ["SIGINT", "SIGTERM", "SIGHUP"])
@pytest.mark.parametrize("count", [1, 2, 40])
def test_a_signal_during_blenders_imports_leaves_no_files(tmp_path, stop, count):
    """Blender has created its temporary folder by then, or is about to."""
    process = signalled(count, "bpy", ["lint", SAMPLE_SCENE], stop, env=os.environ | {"TMPDIR": str(tmp_path)})
    assert (process.returncode, process.stderr) == (130, "\nlensfield: cancelled\n") and not list(tmp_path.iterdir())


def test_imports_do_not_choose_the_temporary_folder():
    """Choosing it writes a probe, which a signal amid the imports could leave behind."""
    completed = subprocess.run([sys.executable, "-c", "import tempfile, lensfield.addon; print(tempfile.tempdir)"],
                               capture_output=True, text=True)
    assert (completed.stdout, completed.stderr) == ("None\n", "")


def test_blenders_command_line_runs_the_same_command(blend, tmp_path, monkeypatch):
    registered = {}
    monkeypatch.setattr(bpy.utils, "register_cli_command", registered.__setitem__)
    monkeypatch.setattr(addon, "register", lambda: None)  # it is already registered
    extension.register()
    assert registered["lensfield"](["lens", "list"]) == 0
    assert registered["lensfield"](["render", str(blend), "--lens", "edmund-54852", "--wavelengths", "550",
                                    "--output", str(tmp_path / "out")]) == 0
    assert len(list((tmp_path / "out").iterdir())) == len(FRAME_FILES | LENS_FILES)


def test_another_lens_can_be_applied_to_a_saved_picture(blend, tmp_path):
    completed = lensfield("render", blend, "--lens", "tessar-50mm", "--wavelengths", 550, "--output", tmp_path / "out")
    assert completed.returncode == 0, completed.stderr
    radiance = tmp_path / "out" / "scene_with_space_Scene_0001_radiance.exr"
    completed = lensfield("apply", radiance, "--lens", "nikkor-28mm", "--lens-quality", "preview", "--stray", "veil",
                          "--glare-index", 4, "--report", tmp_path / "report.json")
    assert completed.returncode == 0 and "equals a sensor of 18.3 x 13.7 mm" in completed.stdout, completed.stderr
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["radiance"] == str(radiance) and 0.03 < report["stray_light"]["shares"]["veil"] < 0.2
    listed = {line for line in completed.stdout.splitlines() if line.startswith(str(tmp_path))}
    assert listed == {str(path) for path in (tmp_path / "out").iterdir()}, "no raw file without a camera"
    assert read_exr(tmp_path / "out" / "scene_with_space_Scene_0001_irradiance.exr").lens_name == "nikkor-28mm"


def test_one_process_serves_successive_commands(tmp_path):
    lines = [json.dumps(["lens", "info", "tessar-50mm"]), json.dumps(["apply", "gone.exr", "--lens", "tessar-50mm"])]
    command = [sys.executable, "-c", "from lensfield.cli import console; console()", "serve"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          text=True) as process:
        for line, status in zip(lines, (0, 1), strict=True):
            print(line, file=process.stdin, flush=True)
            output = iter(process.stdout.readline, "")
            assert next(facts for facts in map(read_message, output) if facts) == {"status": status}
        process.stdin.close()
        assert process.wait(LAST_RESORT_S) == cli.CANCELLED
        assert "not named like a rendered frame" in process.stderr.read()
