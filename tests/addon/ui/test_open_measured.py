"""Opening a calibration in Blender: stored as a package next to the .blend, and shown with its source."""

import bpy
import numpy as np
import pytest

from layouts import Layout
from lensfield.addon.scene.lens_facts import lens_facts
from lensfield.addon.ui.open_measured import PROPERTIES
from lensfield.addon.ui.panels import draw_settings
from lensfield.engine import load_lens
from lensfield.engine.pictures.spectral_exr import write_rgb_exr
from measured_files import LENSFUN, OPENCV_XML, foreign_map

pytestmark = pytest.mark.one_blender


def open_measured(path, **answers):
    assert bpy.ops.lensfield.open_measured(filepath=str(path), **answers) == {"FINISHED"}
    settings = bpy.context.scene.camera.data.lensfield
    assert settings.lens == "FILE"
    return settings.lens_file


def written(path, text):
    path.write_text(text)
    return path


def test_a_calibration_is_stored_next_to_the_blend_and_named_in_the_panel(saved, tmp_path):
    path = written(tmp_path / "lab.xml", OPENCV_XML)
    answers = {"sensor_mm": (6.4, 4.8), "f_number": 2.8, "focus_m": 1.5}
    assert open_measured(path, **answers) == open_measured(path, **answers) == "//lenses/lab.npz"
    lens = load_lens(tmp_path / "film" / "lenses" / "lab.npz")
    assert lens.sensor_mm == pytest.approx((6.4, 6.4 * 31 / 48)) and lens.object_distance_mm == 1500
    assert lens.capture_focal_length_mm == pytest.approx(40 * 6.4 / 48)
    facts = lens_facts(str(tmp_path / "film" / "lenses" / "lab.npz"))
    assert facts.source == lens.source and "blur by diffraction at f/2.8, defocus of a thin lens" in lens.source
    layout = Layout()
    draw_settings(layout, saved)
    assert "Distortion as measured" in " ".join(layout.labels) and "lensfield.open_measured" in layout.shown
    assert open_measured(path) == "//lenses/lab-2.npz"  # with another sensor


def test_an_stmap_and_a_lens_of_lensfun(saved, tmp_path):
    path = tmp_path / "lens_distort.exr"
    write_rgb_exr(foreign_map(-0.1), path)
    assert open_measured(path, focal_mm=30.0, sensor_mm=(36.0, 24.0)) == "//lenses/lens_distort.npz"
    path = written(tmp_path / "mine.xml", LENSFUN)
    assert open_measured(path, focal_mm=20.0, kind="LENSFUN") == "//lenses/mine.npz"
    lens = load_lens(tmp_path / "film" / "lenses" / "mine.npz")
    assert lens.name == "Optik Zoom 20-40mm" and np.ptp(lens.relative_illumination) > 0.3


def test_what_a_file_lacks_is_one_line_and_the_scene_keeps_its_lens(saved, tmp_path):
    before = saved.camera.data.lensfield.lens
    path = tmp_path / "lens_distort.exr"
    write_rgb_exr(foreign_map(-0.1), path)
    for name, message in ((path, "focal length is missing"), (tmp_path / "no.yml", "file is missing"),
                          (written(tmp_path / "mine.xml", LENSFUN), "choose one with --focal-length")):
        with pytest.raises(RuntimeError, match=message):
            bpy.ops.lensfield.open_measured(filepath=str(name))
    assert saved.camera.data.lensfield.lens == before
    assert not (tmp_path / "film" / "lenses").exists()


def test_the_file_browser_offers_every_answer(scene):
    offered = bpy.ops.lensfield.open_measured.get_rna_type().properties.keys()
    assert set(PROPERTIES) == set(offered) - {"rna_type", "filepath", "filter_glob"}
