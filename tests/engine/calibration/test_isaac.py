"""Cameras for Isaac Sim: what USD reads in them, and where their equations put the light of the field map.

Blender's Python wheel contains USD; without it, the tests that read by it are skipped.
"""

import re

import numpy as np
import pytest

from calibrated import FOCAL_MM, FRAME, modelled_lens, radial_lens
from lensfield.engine.calibration.fit import Calibration
from lensfield.engine.calibration.formats import FORMATS, calibrated_for
from lensfield.engine.calibration.models import KANNALA_BRANDT, RADTAN, RATIONAL, THIN_PRISM
from lensfield.engine.calibration.views import View
from lensfield.engine.field.field_map import field_map
from lensfield.engine.image.pixel_grid import PixelGrid

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
    found = re.findall(rf"float omni:lensdistortion:{model}:(\w+) = (\S+)", contents)
    return {name: float(value) for name, value in found}


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


@pytest.fixture
def camera_of(tmp_path):
    """A function: the camera prim that a stage shows which refers to the file of a calibration."""
    pytest.importorskip("bpy", reason="USD is a part of Blender's wheel").utils.expose_bundled_modules()
    usd = pytest.importorskip("pxr.Usd", reason="this Blender has no USD for Python")

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


TYPES = {"opencvPinhole": {"imageSize": "int2"}, "opencvFisheye": {"imageSize": "int2"}}
"""Of attributes by NVIDIA's schemas; others are float."""


@pytest.mark.parametrize("model, schema", [
    (RATIONAL, "OmniLensDistortionOpenCvPinholeAPI"), (KANNALA_BRANDT, "OmniLensDistortionOpenCvFisheyeAPI")],
    ids=["pinhole", "fisheye"])
def test_usd_reads_a_referenced_camera(model, schema, camera_of):
    prim = camera_of(fit_of(model))
    assert prim.GetTypeName() == "Camera" and prim.GetAttribute("horizontalAperture").Get() == pytest.approx(3.08)
    assert prim.GetAttribute("focalLength").Get() == pytest.approx(410 * 0.022)
    assert prim.GetMetadata("apiSchemas").GetAppliedItems() == [schema]
    kind, attributes = distortion(prim)
    assert {name: each for name, (each, _) in attributes.items()} == dict.fromkeys(attributes, "float") | TYPES[kind]


def pixels_of(kind, values, directions):
    """Columns and rows by the equations of a model, of directions to the right, downwards and forwards."""
    model = KANNALA_BRANDT if kind == "opencvFisheye" else THIN_PRISM
    places = model.place(directions, np.array([values[name] for name in model.coefficients]))
    return places * (values["fx"], values["fy"]) + (values["cx"], values["cy"]) - 0.5


@pytest.mark.parametrize("lens, frame, requested, limit_px", [
    (shifted_lens, FRAME, "radtan", 0.01), (wide_lens, WIDE_FRAME, "kannala-brandt", 0.01)],
    ids=["pinhole", "fisheye"])
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
