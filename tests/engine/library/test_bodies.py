"""The bundled cameras, against published figures and ISO 12232; and cameras' files."""

import numpy as np
import pytest

from lensfield.engine.library.bodies import (
    DescribedCamera,
    bundled_cameras,
    described_cameras,
    find_cameras,
    load_camera,
)
from lensfield.engine.runtime.errors import CameraError
from lensfield.engine.sensor.camera_file import camera_text, read_camera
from lensfield.engine.sensor.electrons import response
from lensfield.engine.spectral.spectra import load_spectrum
from refusals import refused

CAMERAS = bundled_cameras()


@pytest.mark.parametrize("name", CAMERAS)
def test_a_bundled_camera_saturates_as_iso_12232_says(name):
    """78 / ISO lux seconds of daylight fill the most sensitive channel's wells, and these fill the converter."""
    camera = CAMERAS[name]
    daylight, nm = load_spectrum("illuminant-d55"), np.arange(380.0, 781.0)
    per_lux_s = response(camera, nm) @ daylight.density_at(nm) / daylight.luminous_flux_per_watt()
    assert per_lux_s.max() * 78 / camera.base_iso == pytest.approx(camera.saturation_e, rel=0.01)
    assert camera.black_dn + camera.gain_at(camera.base_iso) * camera.saturation_e == pytest.approx(camera.white_dn,
                                                                                                  rel=1e-3)
    assert camera.quantum_efficiency.max() == pytest.approx(0.5, abs=1e-4)
    red, green, blue = camera.wavelengths_nm[camera.quantum_efficiency.argmax(axis=1)]
    assert blue < green < red and 430 <= blue <= 480 and 500 <= green <= 550 and 570 <= red <= 620
    assert camera.title and camera.source and camera.notes and dict(camera.provenance).keys() == {
        "size", "sensitivity", "noise"}


@pytest.mark.parametrize("name, size_mm, rows", [
    ("sony-a7-iv", (35.9, 23.9), 4672), ("nikon-d850", (35.9, 23.9), 5504), ("fujifilm-x-t4", (23.5, 15.6), 4160),
    ("panasonic-gx9", (17.3, 13), 3888)])
def test_sensors_have_the_makers_sizes(name, size_mm, rows):
    assert CAMERAS[name].size_mm == pytest.approx(size_mm, abs=0.1)
    assert CAMERAS[name].shape_px[0] == rows


def test_a_list_of_cameras_shows_what_their_files_state():
    assert described_cameras() == {name: DescribedCamera(camera.title, camera.shape_px, camera.size_mm)
                                   for name, camera in CAMERAS.items()}


def test_sensitivities_are_measured_per_joule():
    """Of the a7 IV at 530 nm rawtoaces-data has G at its maximum; per photon, its B peaks at 98 % of that."""
    camera = CAMERAS["sony-a7-iv"]
    red, green, blue = camera.quantum_efficiency
    assert green.max() == 0.5 and camera.wavelengths_nm[green.argmax()] == 530
    assert blue.max() == pytest.approx(0.492, abs=1e-3) and red.max() == pytest.approx(0.271, abs=1e-3)


def test_cameras_are_found_by_words():
    assert list(find_cameras(["sony", "7R"])) == ["sony-a7r-ii", "sony-a7r-iii", "sony-a7r-iv"]
    assert find_cameras(["leica"]) == {}
    assert load_camera("nikon-d700") is CAMERAS["nikon-d700"] is load_camera(CAMERAS["nikon-d700"])


@pytest.mark.parametrize("name", ["fujifilm-x-t4", "generic-three-chip", "canon-eos-5d"])
def test_a_camera_survives_its_file(name, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(camera_text(CAMERAS[name]), encoding="utf-8")
    assert read_camera(path) == CAMERAS[name] == load_camera(path)


@pytest.mark.parametrize("line, changed, words", [
    ("bits = 12", "bits = 12.5", "bits is 12.5"),
    ("bits = 12", "bitz = 12", "bitz is unknown"),
    ("pitch_um = 8.196", "", "pitch_um is missing"),
    ('filters = ["RG", "GB"]', 'filters = "RGGB"', 'filters is RGGB: expected rows of the filter array'),
    ('filters = ["RG", "GB"]', 'filters = ["RG", "GX"]', "filters is X"),
    ("shape_px = [2912, 4368]", "shape_px = [2912]", r"shape_px is \[2912\]"),
    ("R = [", "R = [0.1, ", "quantum_efficiency, G is .*: expected 82 numbers"),
    ("[quantum_efficiency]", "[quantum_efficiencies]", "quantum_efficiencies is unknown"),
    ('format = "lensfield-camera"', 'format = "lensfield-prescription"', "format is lensfield-prescription"),
    ("prnu = 0.006", "prnu = -1", "prnu is -1.0"),
    ('noise = "generic"', 'noise = "secret"', "provenance, noise is secret"),
    ("base_iso = 100", "base_iso = 'base'", "base_iso is base")])
def test_bad_files_are_refused_in_one_line(line, changed, words, tmp_path):
    path, text = tmp_path / "bad.toml", camera_text(CAMERAS["canon-eos-5d"])
    assert line in text
    path.write_text(text.replace(line, changed), encoding="utf-8")
    with pytest.raises(CameraError, match=words) as refusal:
        load_camera(path)
    assert str(refusal.value).startswith(str(path)) and "\n" not in str(refusal.value)


def test_unknown_cameras_are_refused(tmp_path):
    with pytest.raises(CameraError, match="leica-m3: camera is unknown: expected a camera's file"):
        load_camera("leica-m3")
    with refused(CameraError, field="file", value="missing", where="none.toml"):
        load_camera(tmp_path / "none.toml")
