"""The render request of a scene: settings, fields given in their place, and the record of a frame."""

from pathlib import Path

import pytest

from lensfield.addon.job.job import job_of
from lensfield.addon.job.recorded import recorded_fields
from lensfield.addon.ui.common.properties import SETTINGS, LensfieldCameraSettings, LensfieldSettings
from lensfield.cli import _parser
from lensfield.engine import InputError, Options
from lensfield.engine.runtime.setting import settings_of
from lensfield.request import RenderRequest, to_arguments
from refusals import refused
from small_scenes import adjust


@pytest.mark.parametrize("name", SETTINGS)
def test_a_property_has_the_texts_and_choices_of_its_setting(name):
    each = SETTINGS[name]
    prop = {"scene": LensfieldSettings, "camera": LensfieldCameraSettings}[each.owner].bl_rna.properties[name]
    assert (prop.name, prop.description) == (each.name, each.text)
    if each.choices:
        offered = {item.identifier.lower(): (item.name, item.description) for item in prop.enum_items}
        assert {value: texts for value, texts in each.choices.items() if value in offered}.items() <= offered.items()
        assert set(each.choices) - set(offered) <= {"auto"}
    elif each.limits and each.kind is int:
        assert prop.hard_min == each.limits[0]


def test_new_settings_are_the_defaults_of_a_request(scene):
    for name in ("stray_light", "wavelength_count"):
        scene.lensfield.property_unset(name)
    request, unset = scene.lensfield.to_request(), RenderRequest()
    elsewhere = {"lens", "options", "output_folder", "to_compositor"}  # the panel has different defaults for these
    for name in settings_of(RenderRequest):
        assert name in elsewhere or getattr(request, name) == getattr(unset, name), name
    assert request.lens == "tessar-50mm" and request.to_compositor and request.options == Options(accuracy=0.01)


def test_a_given_camera_brings_its_own_sensor(scene):
    settings = scene.camera.data.lensfield
    settings.body = "nikon-d700"
    sensors = {name: scene.lensfield.to_request(camera=name).view_on_sensor for name in ("nikon-d700", "canon-eos-5ds")}
    assert scene.lensfield.to_request().view_on_sensor == settings.view_text() == sensors["nikon-d700"]
    assert sensors["nikon-d700"] != sensors["canon-eos-5ds"]
    settings.view = "CAMERA"
    assert scene.lensfield.to_request(camera="canon-eos-5ds").view_on_sensor == "camera"


def test_given_fields_override_settings_unless_they_are_none(scene, tmp_path):
    adjust(scene, view="CAMERA", unfit="RENDER", wavelength_mode="LIST", wavelength_list="no number")
    request = scene.lensfield.to_request(view="lens", unfit=None, wavelengths_nm=[450, 550], output_folder=tmp_path)
    assert (request.view, request.unfit, request.wavelengths_nm) == ("lens", "render", (450.0, 550.0))
    assert request.output_folder == Path(tmp_path).resolve()
    with pytest.raises(TypeError, match="sharpness"):
        scene.lensfield.to_request(sharpness=1, wavelengths_nm=[550])


@pytest.mark.parametrize("view, expected", [("SENSOR", "24.89x18.66"), ("SUPER35", "super35"), ("LENS", "lens")])
def test_a_custom_sensor_is_a_size(scene, view, expected):
    adjust(scene, view=view, sensor_mm=(24.89, 18.66))
    request = scene.lensfield.to_request()
    assert request.view == expected
    for command in ("apply a_radiance.exr --lens x", "render a.blend --output a", "preview a.blend --output a"):
        assert _parser().parse_args([*command.split(), *to_arguments(view=request.view)]).view == expected


@pytest.mark.parametrize("view", ["full frame", "36", "36x0", "infx24", "SUPER35"])
def test_an_unknown_view_is_refused_with_the_choices(view):
    with refused(InputError, field="view", value=view, match="lens, camera, phone"):
        RenderRequest(view=view)


def test_a_record_contains_the_fields_on_which_a_frame_depends(scene):
    job = job_of(scene, lens="edmund-54852", wavelengths_nm=[450, 550], view="camera", room=0.25, source="digest")
    record = recorded_fields(job)
    marked = {name for name, each in settings_of(RenderRequest).items() if each.recorded}
    assert record.keys() == marked | {"lens", "lens_digest", "camera_digest", "clamp", "settings"}
    assert (record["room"], record["wavelengths_nm"], record["denoise"]) == (0.25, [450.0, 550.0], "off")
    assert record["lens_digest"] == job.lens.digest.hex() and record["options"]["accuracy"] == 0.01
