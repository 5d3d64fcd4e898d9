"""Cameras for Isaac Sim: what USD reads in them, and where their equations put the light of the field map.

Blender's Python wheel contains USD; without it, the tests that read by it are skipped.
"""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest

from calibrated import FOCAL_MM, FRAME, modelled_lens, radial_lens
from lensfield.engine import InputError
from lensfield.engine.calibration.fit import Calibration
from lensfield.engine.calibration.formats import FORMATS, calibrated_for
from lensfield.engine.calibration.models import FTHETA, KANNALA_BRANDT, RADTAN, RATIONAL, THIN_PRISM
from lensfield.engine.calibration.views import View
from lensfield.engine.field.field_map import field_map
from lensfield.engine.image.pixel_grid import PixelGrid
from refusals import refused

WIDE_FRAME = PixelGrid((90, 140), 100.0, centre_px=(61.0, 42.0))


def wide_lens():
    return radial_lens(lambda t: np.arctan(t) * (1 - 0.05 * np.arctan(t)**2), np.linspace(0, 30, 65))


def shifted_lens():
    return modelled_lens(RADTAN, (-0.4, 0.5, 0.011, -0.007))


def text(fit):
    return FORMATS["isaac"].text([View(fit)])


def fit_of(model):
    """A calibration with different values everywhere."""
    coefficients = tuple(0.01 * number for number in range(1, len(model.coefficients) + 1))
    return Calibration(model, FRAME, (400.0, 410.0), (42.0, 61.0), coefficients, 0.02, 0.05, 1.0, "a lens", np.inf, 2.8,
                       550.0, 12.0, (0.12, 0.17, 0.26, 0.075), 2.7, 66.5)


def floats(contents, model):
    """{name: value} of the attributes of type float."""
    pairs = re.findall(rf"float omni:lensdistortion:{model}:(\w+) = (\S+)", contents)
    return {name: float(value) for name, value in pairs}


@pytest.mark.parametrize("model, kind", [(THIN_PRISM, "opencvPinhole"), (KANNALA_BRANDT, "opencvFisheye")])
def test_opencv_s_models(model, kind):
    contents = text(fit_of(model))
    values = floats(contents, kind)
    assert [values.pop(name) for name in ("cx", "cy", "fx", "fy")] == [42.5, 61.5, 400, 410]
    np.testing.assert_allclose([values.pop(name) for name in model.coefficients],
                               0.01 * np.arange(1, len(model.coefficients) + 1))
    assert not values and f"{kind}:imageSize = (140, 90)" in contents and f'model = "{kind}"' in contents
    assert f'["OmniLensDistortionOpenCv{kind[6:]}API"]' in contents
    assert "metersPerUnit = 0.01" in contents  # the aperture is in mm, tenths of a unit


def test_f_theta_counts_angles_in_radians_by_pixels():
    contents = text(replace(fit_of(FTHETA), focal_px=(400.0, 400.0)))
    values = floats(contents, "ftheta")
    assert [values.pop(name) for name in ("nominalWidth", "nominalHeight", "maxFov")] == [140, 90, 24]
    np.testing.assert_allclose([values[f"k{power}"] for power in range(5)],
                               [0, 1 / 400, 0.01 / 400**2, 0.02 / 400**3, 0.03 / 400**4])
    assert "float2 omni:lensdistortion:ftheta:opticalCenter = (42.5, 61.5)" in contents
    assert 'model = "ftheta"' in contents and '["OmniLensDistortionFthetaAPI"]' in contents


def test_f_theta_leads_from_angles_to_radii():
    radii, azimuth = np.array([0.0, 0.3, 0.9]), 0.7
    angles = radii + 0.2 * radii**2 - 0.5 * radii**3 + 0.6 * radii**4
    directions = np.stack([np.sin(angles) * np.cos(azimuth), np.sin(angles) * np.sin(azimuth), np.cos(angles)], axis=1)
    np.testing.assert_allclose(FTHETA.place(directions, np.array([0.2, -0.5, 0.6])),
                               radii[:, None] * (np.cos(azimuth), np.sin(azimuth)), atol=1e-12)


def test_a_trial_polynomial_of_f_theta_without_a_solution_stays_finite():
    """The largest angle of such a polynomial is smaller than the angle of the light."""
    assert np.isfinite(FTHETA.place(np.array([3.0, 1.0, 1.0]), np.array([-2.0, -3.0, -4.0]))).all()


def test_f_theta_is_used_on_request():
    assert calibrated_for("isaac", wide_lens(), WIDE_FRAME, 550.0).model is KANNALA_BRANDT
    assert calibrated_for("isaac", wide_lens(), WIDE_FRAME, 550.0, "ftheta").model is FTHETA
    with refused(InputError, field="--model", value="rational", match="fisheye here.*: use kannala-brandt, ftheta"):
        calibrated_for("isaac", wide_lens(), WIDE_FRAME, 550.0, "rational")
    with refused(InputError, field="--model", value="ftheta", match="--for ros has pinhole, .*, kannala-brandt"):
        calibrated_for("ros", wide_lens(), WIDE_FRAME, 550.0, "ftheta")


def test_f_theta_refuses_an_anamorphic_lens():
    lens = modelled_lens(RADTAN, (-0.4, 0.5, 0.011, -0.007), squeeze=1.5)
    with refused(InputError, field="--model", value="ftheta", match="anamorphic, with a squeeze of 1.5: use pinhole"):
        calibrated_for("isaac", lens, FRAME, 550.0, "ftheta")


@pytest.fixture
def camera_of(tmp_path, monkeypatch):
    """A function: the camera prim of a stage that references the file of a calibration."""
    bpy = pytest.importorskip("bpy", reason="USD is a part of Blender's wheel")
    monkeypatch.setattr(sys, "path", sys.path[:])  # Blender puts all its modules there
    bpy.utils.expose_bundled_modules()
    usd = pytest.importorskip("pxr.Usd", reason="this Blender lacks USD for Python")

    def camera(fit):
        (tmp_path / "camera.usda").write_text(text(fit), encoding="utf-8")
        stage = usd.Stage.CreateInMemory()
        stage.DefinePrim("/World/Camera").GetReferences().AddReference(str(tmp_path / "camera.usda"))
        camera.stages.append(stage)  # a prim does not keep its stage
        return stage.GetPrimAtPath("/World/Camera")

    camera.stages = []
    return camera


def distortion(prim):
    """The model of a camera prim, and {name: (type, value)} of its attributes."""
    model = prim.GetAttribute("omni:lensdistortion:model").Get()
    attributes = [prim.GetAttribute(name) for name in prim.GetAuthoredPropertyNames()
                  if name.startswith(f"omni:lensdistortion:{model}:")]
    return model, {each.GetName().rpartition(":")[2]: (str(each.GetTypeName()), each.Get()) for each in attributes}


TYPES = {"opencvPinhole": {"imageSize": "int2"}, "opencvFisheye": {"imageSize": "int2"},
         "ftheta": {"opticalCenter": "float2"}}
"""Of attributes by NVIDIA's schemas; others are float."""


@pytest.mark.parametrize("model, schema", [
    (RATIONAL, "OmniLensDistortionOpenCvPinholeAPI"), (KANNALA_BRANDT, "OmniLensDistortionOpenCvFisheyeAPI"),
    (FTHETA, "OmniLensDistortionFthetaAPI")], ids=["pinhole", "fisheye", "ftheta"])
def test_usd_reads_a_referenced_camera(model, schema, camera_of):
    prim = camera_of(fit_of(model))
    assert prim.GetTypeName() == "Camera" and prim.GetAttribute("horizontalAperture").Get() == pytest.approx(3.08)
    assert prim.GetAttribute("focalLength").Get() == pytest.approx(410 * 0.022)
    assert prim.GetMetadata("apiSchemas").GetAppliedItems() == [schema]
    kind, attributes = distortion(prim)
    assert {name: each for name, (each, _) in attributes.items()} == dict.fromkeys(attributes, "float") | TYPES[kind]


def pixels_of(kind, values, directions):
    """Columns and rows by the equations of a model, of directions to the right, downwards and forwards."""
    if kind == "ftheta":
        radii = np.linspace(0, 200, 200_001)
        angles = np.polynomial.polynomial.polyval(radii, [values[f"k{power}"] for power in range(5)])
        tangents = np.hypot(*directions[:, :2].T)
        radius = np.interp(np.arctan(tangents), angles, radii)
        return values["opticalCenter"] + directions[:, :2] * (radius / tangents)[:, None] - 0.5
    model = KANNALA_BRANDT if kind == "opencvFisheye" else THIN_PRISM
    places = model.place(directions, np.array([values[name] for name in model.coefficients]))
    return places * (values["fx"], values["fy"]) + (values["cx"], values["cy"]) - 0.5


@pytest.mark.parametrize("lens, frame, requested, limit_px", [
    (shifted_lens, FRAME, "radtan", 0.01), (wide_lens, WIDE_FRAME, "kannala-brandt", 0.01),
    (wide_lens, WIDE_FRAME, "ftheta", 0.05)], ids=["pinhole", "fisheye", "ftheta"])
def test_the_equations_agree_with_the_field_map(lens, frame, requested, limit_px, camera_of):
    """In an oblong picture, off the axis."""
    lens = lens()
    kind, attributes = distortion(camera_of(calibrated_for("isaac", lens, frame, 550.0, requested)))
    row, column = (each.ravel() for each in np.meshgrid(np.linspace(0, 89, 9), np.linspace(0, 139, 11)))
    x_mm, y_mm = field_map(lens).at_wavelength(550.0).source_mm(*frame.position_mm(row, column))
    directions = np.stack([x_mm / FOCAL_MM, -y_mm / FOCAL_MM, np.ones(row.size)], axis=1)
    values = {name: np.array(value) for name, (_, value) in attributes.items()}
    off_px = pixels_of(kind, values, directions) - np.stack([column, row], axis=1)
    assert np.hypot(*off_px.T).max() < limit_px
    if kind == "ftheta":
        farthest_deg = 2 * np.degrees(np.arctan(np.hypot(*directions[:, :2].T))).max()
        assert farthest_deg < values["maxFov"] < farthest_deg + 5
