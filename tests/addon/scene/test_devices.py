"""The device that renders: as requested, or as the scene; for the render only."""

from types import SimpleNamespace

import bpy
import pytest

from lensfield import addon
from lensfield.addon.render.preflight import preflight
from lensfield.addon.scene import devices
from lensfield.addon.scene.denoise import denoise_quickly
from lensfield.addon.scene.devices import CPU, device_of, device_text, use_device
from lensfield.addon.scene.undo import Journal
from lensfield.engine import InputError
from small_scenes import light
from snapshot import differences, snapshot

SMALL = {"lens": "edmund-54852", "depth": "off", "wavelengths_nm": (450, 550, 650)}


@pytest.fixture
def lit_scene(scene):
    light(scene, "POINT", 20.0)
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 24, 16, 1
    scene.lensfield.tier = "PREVIEW"
    return scene


@pytest.fixture
def cards(monkeypatch):
    """Sets the GPUs of this machine: names by kind."""
    def set_cards(**names):
        monkeypatch.setattr(devices, "devices_present", lambda: names)
    set_cards()
    return set_cards


def chosen():
    preferences = bpy.context.preferences.addons["cycles"].preferences
    return preferences.compute_device_type, {each.id for each in preferences.devices if each.use}


def test_a_missing_device_is_refused_before_the_render(lit_scene, cards, tmp_path):
    cards(optix=["A card"], cuda=["A card"])
    before = snapshot()
    with pytest.raises(InputError) as caught:
        addon.render_through_lens(lit_scene, output_folder=tmp_path, device="hip", **SMALL)
    assert (caught.value.field, caught.value.value) == ("--device", "hip")
    assert caught.value.remedy.startswith("this machine has cpu, optix, cuda")
    assert not differences(before, snapshot()) and not any(tmp_path.iterdir())
    assert "--device" in {each.field for each in preflight(lit_scene, output_folder=tmp_path, device="hip").refusals}


def test_the_report_names_the_device_and_the_scene_keeps_its_own(lit_scene, tmp_path):
    lit_scene.cycles.device, preferred = "GPU", chosen()
    result = addon.render_through_lens(lit_scene, output_folder=tmp_path, device="cpu", **SMALL)
    assert result.report.as_dict()["device"] == "CPU"
    assert lit_scene.cycles.device == "GPU" and chosen() == preferred


def test_a_gpu_that_does_not_exist_is_remarked(lit_scene, cards, tmp_path):
    words = "Device GPU Compute: the CPU renders instead"
    for lit_scene.cycles.device in ("CPU", "GPU"):
        remarks = map(str, preflight(lit_scene, output_folder=tmp_path).remarks)
        assert any(words in each for each in remarks) == (lit_scene.cycles.device == "GPU")
    remarks = map(str, preflight(lit_scene, output_folder=tmp_path, device="cpu").remarks)
    assert not any(words in each for each in remarks), "it was asked for"


@pytest.mark.parametrize("denoise, use_gpu, said", [("on", False, True), ("on", True, False), ("off", False, False)])
def test_denoising_by_the_cpu_is_remarked_if_the_gpu_renders(lit_scene, cards, tmp_path, denoise, use_gpu, said):
    cards(cuda=["A card"])
    lit_scene.cycles.device, lit_scene.cycles.denoising_use_gpu = "GPU", use_gpu
    remarks = map(str, preflight(lit_scene, output_folder=tmp_path, denoise=denoise, device="cuda").remarks)
    assert any("Denoise: by the CPU" in each for each in remarks) == said


def test_previews_are_denoised_on_the_device_that_renders(scene):
    for scene.cycles.device in ("CPU", "GPU"):
        scene.cycles.denoising_use_gpu = scene.cycles.device == "CPU"
        with Journal() as journal:
            denoise_quickly(scene, journal)
            assert scene.cycles.denoising_use_gpu == (scene.cycles.device == "GPU")


def test_the_report_of_a_render_remarks_on_it_too(lit_scene, cards, tmp_path):
    lit_scene.cycles.device = "GPU"
    result = addon.render_through_lens(lit_scene, output_folder=tmp_path, **SMALL)
    assert result.report.as_dict()["device"] == "CPU"
    assert any("Device GPU Compute" in line for line in result.report.as_dict()["scene_remarks"])


def test_a_requested_kind_is_used_if_the_preferences_choose_none_of_its_devices(scene, monkeypatch):
    card = SimpleNamespace(name="A card", type="CUDA", use=False)
    preferences = SimpleNamespace(compute_device_type="CUDA", devices=[card], refresh_devices=lambda: None)
    monkeypatch.setattr(devices, "_preferences", lambda: preferences)
    with Journal() as journal:
        use_device(scene, "cuda", journal)
        assert card.use and device_text("cuda") == "CUDA (A card)"
    assert not card.use


def test_a_module_takes_the_first_kind_of_gpu_and_a_program_the_preferred_one(lit_scene, cards):
    cards(cuda=["A card"], oneapi=["Another card"])
    assert device_of(lit_scene, "auto") == CPU
    lit_scene.cycles.device = "GPU"
    assert device_of(lit_scene, "auto") == ("cuda" if bpy.app.module else CPU)
    assert device_of(lit_scene, "oneapi") == "oneapi" and device_of(lit_scene, "cpu") == CPU
    assert device_of(lit_scene, "cuda", traced=True) == CPU, "only OptiX traces lenses"


def test_preferences_and_scene_are_as_before_a_render_on_a_gpu(scene):
    before, preferred = snapshot(), chosen()
    with Journal() as journal:
        use_device(scene, "cuda", journal)
        assert scene.cycles.device == "GPU" and scene.cycles.denoising_use_gpu and chosen()[0] == "CUDA"
        assert device_text("cuda").startswith("CUDA")
    assert not differences(before, snapshot()) and chosen() == preferred
