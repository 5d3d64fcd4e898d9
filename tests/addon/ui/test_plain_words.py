"""Errors in a window's words, from the scenes and lenses that raise them."""

import numpy as np
import pytest

from lensfield.addon.scene.errors import SceneError
from lensfield.addon.scene.requirements import check_scene
from lensfield.addon.ui.common.plain_words import PANORAMA, plain, plain_line
from lensfield.engine import load_lens
from lensfield.engine.depth.depth_range import DepthCheck
from lensfield.engine.depth.slabs import SlabPlan
from lensfield.engine.runtime.errors import InputError, LensError


@pytest.mark.parametrize("kind, words", [("ORTHO", "Orthographic cameras have no lens"), ("PANO", PANORAMA)])
def test_a_camera_without_a_lens_is_named_in_a_sentence(scene, kind, words):
    scene.camera.data.type = kind
    with pytest.raises(SceneError) as error:
        check_scene(scene)
    assert plain(error.value) == words


def test_no_lens_asks_for_one():
    with pytest.raises(LensError) as error:
        load_lens("")
    assert plain(error.value) == "Choose a lens"


def test_a_tilt_that_blocks_all_light_is_stated_in_degrees():
    error = LensError("lens", "image_pose", (-45.0, 3.0, 0.0), "no light reaches the sensor: tilt it less")
    assert plain(error).startswith("Tilt of 45\u00b0 is too much for this lens")


def test_other_errors_keep_their_place_value_and_remedy():
    assert plain(InputError("file", "field", 3, "expected 4")) == "file: field is 3: expected 4"
    assert plain(PermissionError(13, "Permission denied", "/folder")).startswith("/folder")


@pytest.mark.parametrize("borders_mm, far_mm, leaning, light, words", [
    ((), 375, False, None, "In focus: 0.192 m to 0.375 m. The rest (88.0% of the frame) is blurred in 1 layer"),
    ((500, 900), 375, False, 0.4, "In focus: 0.192 m to 0.375 m. The rest (88.0% of the frame) is blurred in 3 layers"),
    ((500,), np.inf, True, 0.4,
     "In focus on the axis: 0.192 m to infinity. The rest (88.0% of the frame) is blurred in 2 layers")])
def test_a_reports_line_on_depth_is_two_sentences(borders_mm, far_mm, leaning, light, words):
    check = DepthCheck(25.0, 192, far_mm, 177, 3350, 0.88, leaning, light)
    slabs = SlabPlan(True, borders_mm, ((0, 0),), behind=1e-3, hidden=3.7e-5, check=check)
    assert plain_line(slabs.text) == words
    assert plain_line(check.text) == f"{words.partition(' is ')[0]} is blurred less than by the real lens"


def test_a_reports_line_on_passes_names_no_colour_difference():
    line = "1 Cycles render at 440, 555, 610 nm: the other wavelengths are estimated from these"
    assert plain_line(f"{line}; colours within a CIEDE2000 of about 8.2") == f"{line}; colours are approximate"
    assert plain_line(line) == line
