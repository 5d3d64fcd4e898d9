"""The camera's part of the panel: bodies, the user's own files, and the sensor that they put behind the lens."""

from types import SimpleNamespace

import bpy
import pytest

from layouts import Layout
from lensfield.addon.job.named_files import named_files
from lensfield.addon.job.photo import ShownExposure
from lensfield.addon.scene import trust
from lensfield.addon.ui.camera_panel import draw_camera
from lensfield.addon.ui.common.lens_worker import facts_now
from lensfield.addon.ui.common.properties import body_items
from lensfield.addon.ui.common.session import session
from lensfield.addon.ui.common.shown_exposure import exposure_text
from lensfield.addon.ui.panels import draw_settings
from lensfield.engine import InputError, load_camera
from lensfield.engine.library.bodies import bundled_cameras
from lensfield.engine.sensor.camera_file import camera_text
from refusals import refused

EXPOSURE = ["iso", "auto_iso", "shutter_s", "auto_shutter", "noise", "develop", "dng"]


def drawn(scene):
    layout = Layout()
    draw_camera(layout, scene, scene.camera.data)
    return layout


def test_a_body_sets_sensor_and_exposure(scene):
    settings, to_request = scene.camera.data.lensfield, scene.lensfield.to_request
    assert to_request().camera == "" and settings.view_text() == "lens" and drawn(scene).shown == ["body"]
    settings.body = "sony-a7-iv"
    assert drawn(scene).shown == ["body", "auto_iso", "auto_shutter", "noise", "develop", "dng"]
    settings.iso, settings.shutter_s = 800, 1 / 60
    request = to_request()
    assert (request.camera, request.iso) == ("sony-a7-iv", 800) and request.shutter_s == pytest.approx(1 / 60, rel=1e-5)
    assert settings.view_text() == request.view_on_sensor == request.view == "35.902x23.9347"
    layout = drawn(scene)
    assert layout.shown == ["body", *EXPOSURE]
    assert "35.9 \u00d7 23.9 mm, 7008 \u00d7 4672 pixels" in layout.labels
    settings.view = "CAMERA"
    assert settings.view_text() == "camera", "the user's choice"
    scene.lensfield.wavelength_first_nm = 500
    assert "leave out part of the camera's response" in " ".join(drawn(scene).labels)


def test_the_exposure_is_shown_as_photographers_write_it(scene):
    """With the f-number of the lens, which does not open to f/1."""
    settings, dof = scene.camera.data.lensfield, scene.camera.data.dof
    settings.lens, settings.body = "cooke-triplet-50mm", "sony-a7-iv"
    settings.shutter_s = 1 / 125
    facts_now(scene)
    assert "1/125 s, f/5" in drawn(scene).labels
    settings.iso = 800
    assert "1/125 s, f/5, ISO 800, EV 8.6" in drawn(scene).labels  # log2(25 * 125 / 8)
    dof.use_dof, dof.aperture_fstop, settings.shutter_s = True, 8.0, 2.5
    facts_now(scene)
    assert "2.5 s, f/8, ISO 800, EV 1.7" in drawn(scene).labels  # log2(64 / 2.5 / 8)
    dof.aperture_fstop = 1.0
    facts_now(scene)
    assert any("2.5 s, f/5, " in line for line in drawn(scene).labels)
    layout, other = Layout(), bpy.data.cameras.new("Other")
    other.lensfield.body, other.lensfield.shutter_s, other.lensfield.iso = "sony-a7-iv", 1 / 8000, 100
    draw_camera(layout, scene, other)
    assert "1/8000 s, ISO 100" in layout.labels, "only the lens of the scene's camera is read"
    assert exposure_text(1 / 125, 0) == "1/125 s", "without an ISO, or an f-number, which may not be known yet"


def test_auto_fixes_a_value_as_metered(scene, monkeypatch):
    settings = scene.camera.data.lensfield
    settings.body = "generic-phone-48"
    assert settings.auto_iso and settings.auto_shutter
    settings.auto_iso = settings.auto_shutter = False
    assert (settings.iso, settings.shutter_s) == (50, pytest.approx(1 / 60)), "the base ISO, without a picture"
    settings.auto_iso = False
    assert settings.iso == 50
    settings.auto_iso = settings.auto_shutter = True
    assert settings.iso == settings.shutter_s == 0 and scene.lensfield.to_request().iso == 0
    shown = SimpleNamespace(exposure=ShownExposure(1 / 250, 137.2), note="",
                            shows_exposure_of=lambda scene: True)
    monkeypatch.setattr(session, "live", shown)
    assert "1/250 s, f/" in " ".join(drawn(scene).labels)
    draw_settings(layout := Layout(folded=True), scene)
    assert "1/250 s, ISO 137" in layout.labels, "in the header, too"
    settings.auto_shutter = False
    assert settings.shutter_s == pytest.approx(1 / 250) and settings.auto_iso
    settings.auto_iso = False
    assert settings.iso == 137
    other = bpy.data.cameras.new("Other").lensfield
    other.auto_iso = False
    assert other.iso == 100, "the picture is the active camera's"


def test_all_bodies_are_offered():
    assert {name for name, *_ in body_items(None, None)} == {"NONE", *bundled_cameras(), "FILE"}


@pytest.mark.one_blender
def test_a_camera_that_no_longer_exists_is_reported(scene):
    scene.camera.data.lensfield["body"] = 987654  # of none of the cameras, as in a .blend of another version
    with pytest.raises(InputError, match="camera body is unknown: choose one that this version of Lensfield has"):
        scene.lensfield.to_request()
    assert "choose one that" in " ".join(drawn(scene).labels)


def test_the_users_own_file_is_read_if_it_is_trusted(scene, tmp_path):
    path = tmp_path / "own.toml"
    path.write_text(camera_text(load_camera("nikon-d700")), encoding="utf-8")
    settings = scene.camera.data.lensfield
    settings.body = "FILE"
    with pytest.raises(InputError, match="camera file is empty: choose a file"):
        scene.lensfield.to_request()
    assert any("choose a file" in line for line in drawn(scene).labels)
    settings.body_file = str(path)  # trusted, because it was chosen
    assert scene.lensfield.to_request().camera == str(path) and "36 \u00d7 24 mm" in drawn(scene).labels[0]
    path.write_text("format = 'lensfield-camera'", encoding="utf-8")
    assert any("version" in line for line in drawn(scene).labels)
    draw_settings(Layout(), scene)


def test_a_file_that_only_the_blend_names_is_not_read(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(trust, "trusts_all", lambda: False)
    monkeypatch.setattr("lensfield.addon.job.named_files.trusts_all", lambda: False)
    with monkeypatch.context() as without_trust:
        without_trust.setattr("lensfield.addon.ui.common.properties.trust", lambda path: None)
        scene.camera.data.lensfield.body, scene.camera.data.lensfield.body_file = "FILE", str(tmp_path / "theirs.toml")
    assert named_files() == {str(tmp_path / "theirs.toml"): "camera"}
    with refused(InputError, field="camera file", where="camera settings"):
        scene.lensfield.to_request()
    layout = Layout()
    draw_settings(layout, scene)
    assert any("Camera: " in line for line in layout.labels)
