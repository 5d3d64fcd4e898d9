"""The immediate focus figures: the focus set by the camera's rings, and how quickly blur grows around it."""

import numpy as np
import pytest

from lensfield.addon.scene.camera import capture_grid, lens_for_view
from lensfield.addon.scene.focus import focus_now
from lensfield.addon.scene.lens_cache import SKETCHED, load_lens
from lensfield.addon.scene.lens_facts import lens_facts
from lensfield.addon.scene.rings import scene_lens
from lensfield.engine.depth.depth_range import blur_per_nearness_px, blur_px
from lensfield.engine.lens.entrance_pupil import focus_nearness
from lensfield.engine.rays.rings import Rings

DEPTHS_M = np.array([0.7, 1.0, 1.4, 2.0, 3.0, 8.0, np.inf])


@pytest.fixture
def turn(scene):
    dof = scene.camera.data.dof

    def turned(lens, focus_m, f_number, view="LENS"):
        scene.camera.data.lensfield.lens, scene.camera.data.lensfield.view = lens, view
        scene.render.resolution_x, scene.render.resolution_y = 480, 320
        dof.use_dof = focus_m is not None
        if focus_m is not None:
            dof.focus_distance, dof.aperture_fstop = focus_m, f_number
        return scene

    return turned


@pytest.mark.sample(2)
@pytest.mark.one_blender
@pytest.mark.parametrize("lens, focus_m, f_number, view", [
    ("sonnar-50mm-f1.5", 1.5, 2.8, "LENS"), ("sonnar-50mm-f1.5", 3.0, 1.5, "CAMERA"),
    ("canon-rf-85mm-f1.2", 1.5, 1.2, "LENS"), ("edmund-54852", None, None, "LENS"),
    ("edmund-54852", None, None, "CAMERA"), ("kodak-petzval-100mm", 4.0, 2.0, "LENS"),
    ("kodak-petzval-100mm", 4.0, 2.0, "CAMERA")])
def test_focus_blurs_like_the_baked_lens(turn, lens, focus_m, f_number, view):
    """To the accuracy of first-order optics: in fast lenses the sine is not the tangent, and inner groups move."""
    scene = turn(lens, focus_m, f_number, view)
    focus = focus_now(scene, lens_facts(lens))
    baked, *_ = scene_lens(scene, lens, view.lower(), "preview")
    pitch_um = capture_grid(scene, baked, [550.0]).pitch_um
    expected = blur_px(baked, pitch_um, DEPTHS_M * 1e3)
    assert focus.blur_px(DEPTHS_M) == pytest.approx(expected, rel=0.1, abs=0.1 * np.abs(expected).max())
    if focus_m:
        assert focus.focus_m == pytest.approx(focus_m, rel=1e-3)
        assert np.all(np.sign(focus.blur_px(DEPTHS_M)) == np.sign(focus_m - DEPTHS_M))


def test_rings_are_clamped_to_the_lens_range(turn):
    near = focus_now(turn("sonnar-50mm-f1.5", 0.01, 0.5), lens_facts("sonnar-50mm-f1.5"))
    *_, closest_mm = lens_facts("sonnar-50mm-f1.5").reach
    assert near.focus_m == pytest.approx(closest_mm / 1e3)
    open_wide = focus_now(turn("sonnar-50mm-f1.5", 2.0, 1.5), lens_facts("sonnar-50mm-f1.5"))
    wider = focus_now(turn("sonnar-50mm-f1.5", 2.0, 0.5), lens_facts("sonnar-50mm-f1.5"))
    assert wider.blur_px_m == pytest.approx(open_wide.blur_px_m)
    assert focus_now(turn("sonnar-50mm-f1.5", 2.0, 3.0), lens_facts("sonnar-50mm-f1.5")).blur_px_m == pytest.approx(
        open_wide.blur_px_m / 2, rel=0.05)


@pytest.mark.one_blender
@pytest.mark.parametrize("lens, view", [("sonnar-50mm-f1.5", "LENS"), ("sonnar-50mm-f1.5", "CAMERA"),
                                        ("cooke-42mm-2x", "LENS")])
def test_a_tilted_lens_leans_like_the_baked_one(turn, lens, view):
    """To the right and upwards by different angles; the plane of focus leans the same way as in the lens data."""
    tilt_deg = (1.5, -2.5)
    scene = turn(lens, 2.0, 4.0, view)
    scene.camera.data.lens = 28.0
    assert focus_now(scene, lens_facts(lens)).lean_per_m == (0.0, 0.0)
    scene.camera.data.lensfield.tilt_deg = np.radians(tilt_deg)
    focus = focus_now(scene, lens_facts(lens))
    baked, _ = lens_for_view(scene, load_lens(lens, Rings(2000.0, 4.0, tilt_deg=tilt_deg), SKETCHED), view.lower())
    right, up = 0.11, -0.07
    ideal_mm = baked.capture_focal_length_mm * np.array([right / baked.squeeze, up])
    assert all(abs(per_m) > 0.1 for per_m in focus.lean_per_m)
    for places in ((ideal_mm[0], 0.0), (0.0, ideal_mm[1]), ideal_mm):
        tangents = tuple(place and tangent for place, tangent in zip(places, (right, up), strict=True))
        expected_per_m = 1e3 * (focus_nearness(baked, *places) - focus_nearness(baked))
        pitch_um = capture_grid(scene, baked, [550.0]).pitch_um
        moved = (focus.blur_px(2.0) - focus.blur_px(2.0, tangents)) / (blur_per_nearness_px(baked, pitch_um) / 1e3)
        assert moved == pytest.approx(expected_per_m, rel=0.1)
