"""A complete bake: its progress reports and its cancellation."""

import numpy as np
import pytest

from lensfield.engine.bake import psfs as module
from lensfield.engine.bake.bake import bake
from lensfield.engine.bake.quality import QUALITIES, SKETCH
from lensfield.engine.bake.sampling import picture_samples
from lensfield.engine.field.field_map import field_map
from lensfield.engine.library import BUNDLED, prescription_of
from lensfield.engine.prescription.readers import read_prescription

TWO_NM = (450.0, 650.0)


@pytest.fixture(scope="module")
def triplet():
    return read_prescription(BUNDLED / "prescriptions" / "cooke-triplet-50mm.toml")


def test_too_few_heights_are_stated_in_the_notes(triplet):
    few = bake(triplet, quality="preview", heights=5, wavelengths_nm=TWO_NM, samples=33)
    assert few.heights_mm.size == 5
    assert few.notes.startswith(triplet.notes) and "Halfway between two heights, " in few.notes
    many = bake(triplet, quality="preview", wavelengths_nm=TWO_NM, samples=33)
    assert many.heights_mm.size > 9 and "Half way" not in many.notes


def test_lengthened_waves_are_stated_in_the_notes(triplet):
    lens = bake(triplet, quality="preview", heights=2, wavelengths_nm=TWO_NM, samples=5, pitch_um=100.0)
    assert "Diffraction is computed with wavelengths lengthened by a factor of up to 4.1." in lens.notes


@pytest.mark.parametrize("name", ["cooke-triplet-50mm", "leica-noctilux-50mm", "edmund-54852"])
def test_a_sketch_serves_pixels_of_a_160th_of_the_picture(name):
    """At wavelengths between its own, and at places between its heights."""
    prescription = prescription_of(name)
    lens, sketch = (bake(prescription, quality=quality, wavelengths_nm=nm, samples=33) for quality, nm in
                    (("preview", (450.0, 610.0)), (SKETCH, (400.0, 550.0, 700.0))))
    assert sketch.heights_mm.size == 4
    radius_mm = np.linspace(0, 0.95, 100) * lens.real_height_mm[:, -1].min()
    x_mm, y_mm = 0.6 * radius_mm, 0.8 * radius_mm
    for nm in (450.0, 610.0):
        fields = [field_map(each).at_wavelength(nm) for each in (lens, sketch)]
        places_mm, sketched_mm = (np.array(field.source_mm(x_mm, y_mm)) for field in fields)
        assert np.abs(sketched_mm - places_mm).max() < 0.3 / 160 * lens.sensor_mm[0]
        light, sketched_light = (field.relative_illumination(x_mm, y_mm) for field in fields)
        assert np.abs(sketched_light - light).max() < 0.05


def test_a_cancelled_bake_ends_after_the_psfs_in_progress(triplet, monkeypatch):
    summed = []

    def point_spread(*arguments):
        summed.append(arguments)
        return np.full((17, 17), 1 / 17**2)

    def progress(fraction, label):
        if label == "Computing PSFs":
            raise KeyboardInterrupt

    monkeypatch.setattr(module, "point_spread", point_spread)
    with pytest.raises(KeyboardInterrupt):
        bake(triplet, quality="preview", heights=200, samples=17, pitch_um=8.0, workers=2, progress=progress)
    assert 31 <= len(summed) < 199 * 31


@pytest.mark.parametrize("needed_um, sensor_mm, quality, number", [
    (300.0, (36.0, 24.0), "standard", 65), (1000.0, (36.0, 24.0), "standard", 81), (300.0, (4.8, 3.6), "preview", 121),
    (300.0, (4.8, 3.6), "reference", 129), (1000.0, (36.0, 24.0), "preview", 65)])
def test_samples_are_as_fine_as_pixels_up_to_a_limit(needed_um, sensor_mm, quality, number):
    assert picture_samples(needed_um, sensor_mm, QUALITIES[quality]) == number
