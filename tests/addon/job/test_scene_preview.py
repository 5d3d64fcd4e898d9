"""The preview of a loaded scene, without a window: the same lens as in a render."""

import numpy as np
import OpenEXR
import pytest

from lensfield import addon
from small_scenes import material, set_world, wall


def last_picture(scene, folder, **given):
    """R, G and B of the last picture of a scene's preview."""
    return last_shown(scene, folder, **given)[0]


def last_shown(scene, folder, wavelengths_nm=(550.0,), **given):
    """R, G and B of the last picture of a scene's preview, in a new folder, and the facts about it."""
    preview, shown = addon.open_preview(scene, lens="zeiss-biotar-50mm", view="camera", lens_quality="preview",
                                        wavelengths_nm=wavelengths_nm, output_folder=folder / "new", **given), []
    preview.run(shown.append, lambda fraction, label: None)
    preview.close()
    with OpenEXR.File(shown[-1]["picture"], separate_channels=True) as file:
        return np.stack([file.parts[0].channels[name].pixels for name in "RGB"]), shown[-1]


@pytest.fixture
def lit(scene):
    """A bright square that fills the middle of the picture, in front of the sky."""
    set_world(scene)
    glow, shader = material("Glow", "ShaderNodeEmission")
    shader.inputs["Strength"].default_value = 0.8
    wall(scene, glow, side_m=0.3)
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 24, 16, 4
    scene.cycles.film_exposure = 2.0
    return scene


def exposed(scene, folder, **given):
    return last_shown(scene, folder, (450.0, 500.0, 550.0, 600.0, 650.0), **given)


def test_the_preview_has_the_brightness_of_the_cameras_exposure(lit, tmp_path):
    light, facts = exposed(lit, tmp_path / "light")
    assert "exposure" not in facts
    body = {"camera": "sony-a7-iv", "f_number": 4.0}
    auto, facts = exposed(lit, tmp_path / "auto", **body)
    assert auto.mean() == pytest.approx(10 / 78, rel=0.03) and facts["exposure"]["iso"] == 100
    half_s = facts["exposure"]["shutter_s"] / 2
    darker, facts = exposed(lit, tmp_path / "fixed", **body, iso=100.0, shutter_s=half_s)
    assert darker == pytest.approx(auto / 2, rel=0.02) and facts["exposure"] == {"shutter_s": half_s, "iso": 100.0}
    brighter, facts = exposed(lit, tmp_path / "iso", **body, shutter_s=half_s)
    assert facts["exposure"]["iso"] == pytest.approx(200, rel=0.02) and brighter == pytest.approx(auto, rel=0.02)
    burnt, _ = exposed(lit, tmp_path / "burnt", **body, iso=100.0, shutter_s=1000 * half_s)
    assert burnt.min() == burnt.max() == 1
    plain, facts = exposed(lit, tmp_path / "plain", **body, develop=False)
    assert "exposure" in facts
    np.testing.assert_array_equal(plain, exposed(lit, tmp_path / "same", f_number=4.0)[0])
    _, stopped = exposed(lit, tmp_path / "stopped", **body | {"f_number": 8.0}, iso=100.0)
    assert stopped["exposure"]["shutter_s"] == pytest.approx(8 * half_s, rel=0.05), "two stops more"


def test_the_preview_meters_like_the_render(lit, tmp_path):
    given = {"camera": "sony-a7-iv", "f_number": 4.0, "view": "camera", "lens_quality": "preview"}
    _, shown = exposed(lit, tmp_path / "preview", camera="sony-a7-iv", f_number=4.0)
    result = addon.render_through_lens(lit, lens="zeiss-biotar-50mm", output_folder=tmp_path / "render", depth="off",
                                       wavelengths_nm=tuple(range(400, 701, 20)), **given)
    taken = result.report.as_dict()["camera"]
    assert shown["exposure"]["shutter_s"] == pytest.approx(taken["shutter_s"], rel=0.05)


def test_the_lens_follows_the_depth_of_field_of_the_camera(scene, tmp_path):
    set_world(scene)
    wall(scene, material("Grey", "ShaderNodeBsdfDiffuse", (0.5, 0.5, 0.5))[0], side_m=0.3)
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 8, 6, 1
    dof = scene.camera.data.dof
    dof.use_dof, dof.aperture_fstop, dof.focus_distance = True, 5.6, 2.0
    by_camera, stated, wide_open = (last_picture(scene, tmp_path / name, **given) for name, given in (
        ("camera", {}), ("stated", {"f_number": 5.6, "focus": 2000.0}), ("open", {"f_number": 1.4, "focus": 2000.0})))
    np.testing.assert_array_equal(by_camera, stated)
    assert np.abs(by_camera - wide_open).max() > 0.05 * wide_open.max()
