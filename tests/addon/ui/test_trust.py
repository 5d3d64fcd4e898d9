"""Files named by an untrusted .blend: displayed, but not accessed automatically until the user trusts the file."""

import os
import shutil
import sys
from functools import partial
from pathlib import Path

import bpy
import numpy as np
import pytest
from PIL import Image

from layouts import Layout
from lensfield.addon.job.named_files import named_files
from lensfield.addon.render.child import save_copy
from lensfield.addon.scene import trust
from lensfield.addon.scene.compositor import compositor_state, lay_into_compositor
from lensfield.addon.scene.compositor_watch import check, look_again
from lensfield.addon.scene.fingerprint import scene_fingerprint
from lensfield.addon.ui import window_render
from lensfield.addon.ui.common import lens_worker
from lensfield.addon.ui.common.session import session
from lensfield.addon.ui.panels import draw_settings
from lensfield.addon.ui.preview import preview
from lensfield.engine.library import BUNDLED
from lensfield.engine.pictures.spectral_exr import write_rgb_exr
from lensfield.engine.runtime.errors import InputError
from refusals import refused
from small_scenes import adjust, material
from waiting import LAST_RESORT_S

touched = []
"""Names of all files that are opened, listed, or searched for."""


def note(event, arguments):
    if event in ("open", "os.listdir", "os.scandir", "os.mkdir"):
        touched.append(str(arguments[0]))


sys.addaudithook(note)


def noted(look, path, *given, **named):
    touched.append(str(path))
    return look(path, *given, **named)


@pytest.fixture
def in_a_window(monkeypatch):
    """Without a render requested by a command: nothing is trusted."""
    trust.forget_trust()
    monkeypatch.setattr(trust, "_user_must_confirm", lambda: False)
    for look in (os.stat, os.lstat):
        monkeypatch.setattr(os, look.__name__, partial(noted, look))
    yield
    trust.forget_trust()


@pytest.fixture
def stranger(scene, tmp_path, in_a_window):
    """The scene of a .blend that names a lens, a spectrum and pictures, all elsewhere; and their folder."""
    away = tmp_path / "away"
    away.mkdir()
    shutil.copy(BUNDLED / "edmund-54852.npz", away / "lens.npz")
    Image.new("RGB", (90, 60)).save(away / "lens.png")
    (away / "paint.spd").write_text("400 0.1\n700 0.9\n")
    write_rgb_exr(np.ones((36, 48, 3), np.float32), away / "Scene_0001_lens_image.exr")
    adjust(scene, lens="FILE", lens_file=str(away / "lens.npz"), output_folder=str(away))
    material("Paint", "ShaderNodeBsdfDiffuse", (1, 1, 1))[0].lensfield.reflectance = str(away / "paint.spd")
    lay_into_compositor(scene, away / "Scene_0001_lens_image.exr", fingerprint="of another scene")
    bpy.data.materials["Paint"].use_fake_user = True
    backdrop = bpy.data.objects.new("Backdrop", None)
    backdrop.empty_display_type, backdrop.data = "IMAGE", bpy.data.images.load(str(away / "lens.png"))
    scene.collection.objects.link(backdrop)
    (tmp_path / "own").mkdir()
    path = tmp_path / "own" / "stranger.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), relative_remap=False)
    trust.forget_trust()
    bpy.ops.wm.read_homefile(use_empty=True)
    touched.clear()
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return away


def draw(scene):
    layout = Layout()
    draw_settings(layout, scene)
    return layout


def touches(folder):
    return [path for path in touched if path.startswith(str(folder))]


def all_that_runs_by_itself(scene):
    """Panels, timers and handlers."""
    draw(scene)
    check()
    look_again()
    scene.camera.location.x += 1
    bpy.context.view_layer.update()
    scene.frame_set(2)
    scene.lensfield.compositor_shows = "ALWAYS"
    scene.camera.data.lensfield.iris_roundness = 0.5
    scene.camera.data.lensfield.view = "CAMERA"
    draw(scene)
    compositor_state(scene)
    bpy.ops.lensfield.show_sheet.poll(), bpy.ops.lensfield.remove_from_compositor.poll()


def test_named_files_are_not_touched(stranger):
    all_that_runs_by_itself(bpy.context.scene)
    assert not touches(stranger) and not bpy.data.images["lens.png"].has_data


def test_a_fingerprint_opens_no_image(stranger):
    """Reading some of an image's properties would open it."""
    assert scene_fingerprint(bpy.context.scene) and not bpy.data.images["lens.png"].has_data


def test_named_paths_are_shown_with_one_button(stranger):
    layout = draw(bpy.context.scene)
    text = " ".join(layout.labels)
    assert all(str(stranger / name) in text.replace(" ", "") or name in text for name in ("lens.npz", "paint.spd"))
    assert layout.shown == ["lensfield.trust", "lens"]
    assert set(named_files().values()) == {"lens", "spectrum", "output"}


def test_trusted_files_are_read(stranger):
    scene = bpy.context.scene
    assert bpy.ops.lensfield.trust() == {"FINISHED"}
    assert not named_files() and not bpy.ops.lensfield.trust.poll()
    draw(scene)
    assert lens_worker.lens_request(scene).baked.result(LAST_RESORT_S)
    assert "lensfield.render" in draw(scene).shown and touches(stranger)


@pytest.mark.parametrize("start", [lambda scene: window_render.start(scene), window_render.start_again, preview.start],
                         ids=["render", "apply", "preview"])
def test_nothing_starts_before_the_files_are_trusted(stranger, start):
    with refused(InputError, field="lens", where="this file",
                 match="the path comes from the .blend: check it, then press Trust"):
        start(bpy.context.scene)
    assert not touches(stranger)


@pytest.mark.parametrize("lens", ["tessar-50mm", "FILE"])
def test_checking_the_scene_reads_no_untrusted_files(stranger, lens):
    scene = bpy.context.scene
    scene.camera.data.lensfield.lens, scene.lensfield.output_folder = lens, "//lensfield/"
    bpy.ops.mesh.primitive_plane_add()
    bpy.context.object.data.materials.append(bpy.data.materials["Paint"])
    bpy.ops.lensfield.lint()
    refusals = session.check.result.refusals
    assert refusals and all("press Trust" in str(refusal) for refusal in refusals)
    assert not touches(stranger)


def test_files_chosen_by_the_user_are_trusted(stranger, tmp_path):
    shutil.copytree(stranger, tmp_path / "chosen")
    touched.clear()
    scene = bpy.context.scene
    scene.camera.data.lensfield.lens_file = str(tmp_path / "chosen" / "lens.npz")
    scene.lensfield.output_folder = "//pictures/"
    bpy.data.materials["Paint"].lensfield.reflectance = "400:0.1, 700:0.9"
    assert named_files() == {str(stranger): "output"}  # from the compositor
    bpy.ops.lensfield.remove_from_compositor()
    assert not named_files() and not touches(stranger)
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    assert not named_files()


def test_an_output_folder_does_not_make_a_lens_in_it_trusted(stranger):
    scene = bpy.context.scene
    scene.lensfield.output_folder = str(stranger) + os.sep
    named = named_files()
    assert str(stranger) not in named and named[str(stranger / "lens.npz")] == "lens"


def test_appended_data_is_not_trusted(stranger, tmp_path):
    bpy.ops.lensfield.trust()
    other = tmp_path / "other.blend"
    paint = bpy.data.materials["Paint"].copy()
    paint.name, paint.lensfield["reflectance"] = "Appended", str(stranger.parent / "elsewhere.spd")
    bpy.data.libraries.write(str(other), {paint})
    bpy.data.materials.remove(paint)
    assert not named_files()
    with bpy.data.libraries.load(str(other)) as (_, into):
        into.materials = ["Appended"]
    assert named_files() == {str(stranger.parent / "elsewhere.spd"): "spectrum"}


def test_a_file_that_may_run_scripts_is_trusted(stranger, monkeypatch):
    preferences = bpy.context.preferences
    assert named_files()
    preferences.filepaths.use_scripts_auto_execute = True
    try:
        assert not named_files()
        excluded = preferences.autoexec_paths.new()
        excluded.path = str(Path(bpy.data.filepath).parent)
        assert named_files()
        excluded.use_glob, excluded.path = True, "*/stranger.blend"
        assert named_files()
        preferences.autoexec_paths.remove(excluded)
    finally:
        preferences.filepaths.use_scripts_auto_execute = False


@pytest.mark.parametrize("path, near", [
    ("//lensfield/", True), ("//", True), ("//a/../b", True), ("//../b", False), ("//a/../../b", False),
    ("////server/share", False), ("//\\\\server\\share", os.sep == "/"), ("/net/host/share", False),
    ("\\\\server\\share", False)])
def test_paths_near_the_blend_are_recognised(scene, tmp_path, path, near):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "own.blend"))
    assert trust.is_near_blend(bpy.path.abspath(path)) == near


@pytest.mark.parametrize("path, near", [("//lensfield/", True), ("//../b", False), ("/b", False)])
def test_paths_near_an_unsaved_file_are_recognised(scene, path, near):
    assert trust.is_near_blend(bpy.path.abspath(path)) == near


def test_a_new_file_names_nothing(scene, in_a_window):
    assert not named_files() and "lensfield.render" in draw(scene).shown


def test_copying_a_file_for_a_render_keeps_trust(stranger, tmp_path):
    bpy.ops.lensfield.trust()
    save_copy(tmp_path)
    assert not named_files()
