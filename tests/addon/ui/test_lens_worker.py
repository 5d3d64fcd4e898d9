"""The panel does not wait for bakes: its remarks during a bake, and the assignment of results."""

from threading import Event

import bpy
import numpy as np
import pytest

from layouts import Layout
from lenses import make_lens
from lensfield.addon.scene.lens_cache import load_lens
from lensfield.addon.scene.lens_facts import lens_facts
from lensfield.addon.ui import window_render
from lensfield.addon.ui.common import lens_worker
from lensfield.addon.ui.panels import draw_settings
from lensfield.engine import LensError
from lensfield.engine.field.field_map import field_map
from lensfield.engine.library import BUNDLED, clamped_rings
from lensfield.engine.rays.rings import Rings
from lensfield.engine.runtime.errors import Stopped
from waiting import LAST_RESORT_S

RINGS = {"use_dof", "focus_object", "focus_distance", "aperture_fstop"}


class Oven:
    """Bakes on command, and records the requests."""

    def __init__(self):
        self.requests, self.opened, self.entered, self.error = [], Event(), Event(), None

    def load_lens(self, name, rings, quality, progress, wavelengths_nm, edges_mm):
        self.requests.append((name, rings.f_number, wavelengths_nm))
        while not self.opened.wait(0.01):
            progress(0.4, "Summing up PSFs")
            self.entered.set()
        progress(1.0, "Summing up PSFs")
        if self.error:
            raise self.error
        return make_lens(name=f"{name} at f/{rings.f_number}")


@pytest.fixture
def oven(monkeypatch):
    oven = Oven()
    monkeypatch.setattr(lens_worker, "load_lens", oven.load_lens)
    monkeypatch.setattr(lens_worker, "loaded_lens", lambda *args: None)
    monkeypatch.setattr(lens_worker, "STILL_S", 0.0)
    yield oven
    lens_worker.forget_requests()
    oven.opened.set()


def turn(scene, f_number):
    scene.camera.data.dof.use_dof, scene.camera.data.dof.aperture_fstop = True, f_number


def drawn(scene):
    """The panel after the lens has been identified."""
    lens_worker.lens_request(scene).read.exception(LAST_RESORT_S)
    layout = Layout()
    draw_settings(layout, scene)
    return layout


def panel_text(scene):
    return " ".join(drawn(scene).labels)


def answered(scene):
    lens_worker.lens_request(scene).baked.result(LAST_RESORT_S)
    return lens_worker.requested_lens(scene)


def test_a_panel_is_drawn_while_its_lens_is_baked(scene, oven):
    assert lens_worker.requested_lens(scene) is None and oven.entered.wait(LAST_RESORT_S)
    assert lens_worker.BAKING in panel_text(scene) and "f/5.5 \u00b7" in panel_text(scene)
    assert "Focused at infinity" in panel_text(scene)
    assert lens_worker.lens_request(scene).fraction == 0.4
    oven.opened.set()
    assert answered(scene) is not None and lens_worker.BAKING not in panel_text(scene)
    assert len(oven.requests) == 1


def test_only_the_newest_request_is_answered(scene, oven):
    turn(scene, 8)
    first = lens_worker.lens_request(scene)
    assert oven.entered.wait(LAST_RESORT_S)
    turn(scene, 11)
    assert lens_worker.requested_lens(scene) is None
    assert isinstance(first.baked.exception(LAST_RESORT_S), Stopped)  # although its oven is shut
    oven.opened.set()
    assert answered(scene).name == "tessar-50mm at f/11.0"


def test_a_turning_ring_bakes_nothing(scene, oven, monkeypatch):
    monkeypatch.setattr(lens_worker, "STILL_S", LAST_RESORT_S)
    for f_number in (8, 9, 10):
        turn(scene, f_number)
        text = panel_text(scene)
        assert f"f/{f_number} \u00b7" in text and "Focused at 10 m" in text and "f/5.5 to f/22, closest focus" in text
    assert not oven.requests


def test_a_lens_is_baked_for_the_wavelengths_of_the_render(scene, oven):
    oven.opened.set()
    scene.lensfield.wavelength_mode = "LIST"
    for text, wavelengths_nm in (("450, 610", (450.0, 610.0)), ("450, 6x", None)):
        scene.lensfield.wavelength_list = text
        assert answered(scene) and oven.requests[-1][-1] == wavelengths_nm


def test_an_old_lens_is_not_shown_for_a_new_request(scene, oven):
    oven.opened.set()
    turn(scene, 8)
    assert answered(scene)
    oven.opened.clear()
    turn(scene, 16)
    assert lens_worker.requested_lens(scene) is None and "f/16 \u00b7" in panel_text(scene)


@pytest.mark.parametrize("error, line", [
    (LensError("tessar-50mm", "field height", "9 mm", "end the field earlier"), "field height is 9 mm"),
    (FloatingPointError("overflow"), "not available (FloatingPointError): overflow")])
def test_a_failed_bake_shows_its_error(scene, oven, error, line):
    oven.error = error
    oven.opened.set()
    lens_worker.lens_request(scene).baked.exception(LAST_RESORT_S)
    for _ in range(2):
        assert line in panel_text(scene) and lens_worker.BAKING not in panel_text(scene)


def test_an_unreadable_lens_shows_its_error(scene, oven, tmp_path):
    scene.camera.data.lensfield.lens, scene.camera.data.lensfield.lens_file = "FILE", str(tmp_path / "none.toml")
    lens_worker.lens_request(scene).baked.exception(LAST_RESORT_S)
    assert "none.toml" in panel_text(scene).replace(" ", "") and not oven.requests


def test_a_request_from_a_deleted_scene_is_dropped(scene, oven):
    request = lens_worker.lens_request(scene)
    assert oven.entered.wait(LAST_RESORT_S)
    other = bpy.data.scenes.new("Other")
    other.camera = scene.camera
    bpy.data.scenes.remove(scene)
    lens_worker.lens_request(other)
    assert isinstance(request.baked.exception(LAST_RESORT_S), Stopped)


def test_each_scene_has_a_separate_request(scene, oven):
    other = bpy.data.scenes.new("Other")
    other.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    other.camera.data.lensfield.lens = "kodak-petzval-100mm"
    first, second = lens_worker.lens_request(scene), lens_worker.lens_request(other)
    assert lens_worker.lens_request(scene) is first and lens_worker.lens_request(other) is second
    assert not first.dropped.is_set()


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", ["edmund-54852", "muller-fisheye-25mm", "nikkor-28mm", "tessar-50mm"])
@pytest.mark.one_blender
@pytest.mark.parametrize("rings", [Rings(), Rings(2000.0, 8.0)])
def test_facts_known_before_the_bake_match_the_baked_lens(name, rings):
    facts, lens = lens_facts(name, rings), load_lens(name, rings, "preview")
    for field in ("efl_mm", "capture_focal_length_mm", "sensor_mm"):
        np.testing.assert_allclose(getattr(facts, field), getattr(lens, field), rtol=1e-6)
    covered = field_map(lens).covered_diagonal(lens.sensor_mm)
    width_mm, height_mm = lens.sensor_mm
    edges_mm = -width_mm / 2, -height_mm / 2, width_mm / 2, height_mm / 2
    assert facts.field_on(edges_mm)[2] == pytest.approx(covered, rel=1e-4)
    assert facts.focus_mm == pytest.approx(lens.object_distance_mm + lens.entrance_pupil_mm)


def test_a_shift_requests_only_lenses_on_a_grid_again(scene, oven):
    first = lens_worker.lens_request(scene)
    assert first.read.result(LAST_RESORT_S).radial
    scene.camera.data.shift_y = 0.3
    assert lens_worker.lens_request(scene) is first
    scene.camera.data.lensfield.tilt_deg = 0.03, 0.0
    tilted = lens_worker.lens_request(scene)
    assert tilted.read.result(LAST_RESORT_S) and lens_worker.lens_request(scene) is tilted
    scene.camera.data.shift_y = 0.0
    assert lens_worker.lens_request(scene) is not tilted


def test_operators_of_a_window_need_no_bake(scene, tmp_path, oven, monkeypatch):
    """The oven stays closed: neither a render's start nor a matched camera waits for it."""
    monkeypatch.setattr(window_render, "window_digest", lambda scene: "")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    scene.camera.data.lensfield.copy = 3
    assert bpy.ops.lensfield.match_camera() == {"FINISHED"}
    window_render.start(scene)
    window_render.end()
    assert not oven.opened.is_set() and lens_worker.is_baking(scene)
    oven.opened.set()
    assert answered(scene) and not lens_worker.is_baking(scene)


def test_a_lens_package_is_fixed(scene, tmp_path):
    package = tmp_path / "own.npz"
    package.write_bytes((BUNDLED / "edmund-54852.npz").read_bytes())
    scene.camera.data.lensfield.lens, scene.camera.data.lensfield.lens_file = "FILE", str(package)
    turn(scene, 16)
    layout = drawn(scene)
    assert RINGS <= set(layout.greyed) and "Fixed focus and f-stop" in layout.labels
    assert "focused_wide_open" not in layout.shown


def test_the_panel_shows_the_cameras_rings(scene):
    scene.lensfield.property_unset("stray_light")
    assert set(drawn(scene).greyed) == RINGS - {"use_dof"} and RINGS <= set(drawn(scene).shown)
    scene.camera.data.dof.use_dof = True
    assert not drawn(scene).greyed and "focused_wide_open" in drawn(scene).shown
    scene.camera.data.dof.focus_object = scene.camera
    assert drawn(scene).greyed == ["focus_distance"]


def test_settings_beyond_the_lens_range_are_reported(scene):
    turn(scene, 2)
    scene.camera.data.dof.focus_distance = 0.1
    for words in clamped_rings("tessar-50mm", Rings(100.0, 2.0)):
        assert words in panel_text(scene)
