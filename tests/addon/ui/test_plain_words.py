"""Errors in a window's words, from the scenes and lenses that raise them."""

import pytest

from lensfield.addon.scene.errors import SceneError
from lensfield.addon.scene.requirements import check_scene
from lensfield.addon.ui.plain_words import PANORAMA, plain
from lensfield.engine import load_lens
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
