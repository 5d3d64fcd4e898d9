"""`lensfield develop` and `lensfield camera`."""

import json
from dataclasses import replace

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from dng_fields import fields
from lensfield import cli
from lensfield.commands.arguments import given_fields
from lensfield.engine import SpectralImage, load_lens
from lensfield.engine.library.bodies import bundled_cameras, load_camera
from lensfield.engine.pictures.spectral_exr import read_exr, read_parts, write_exr
from lensfield.engine.sensor.camera_file import camera_text
from lensfield.engine.spectral.spectra import load_spectrum
from lensfield.request import CAMERA_FIELDS
from seed import SEED

rawpy = pytest.importorskip("rawpy")
NM = np.linspace(400, 700, 7)


def run(*arguments):
    return cli.main([str(argument) for argument in arguments])


@pytest.fixture
def scene(tmp_path):
    """A lens image of daylight on 90 x 130 of a Nikon D700's pixels: a ramp to the right, and a dark bottom."""
    light = 0.05 * load_spectrum("illuminant-d65").density_at(NM)[:, None, None] * np.linspace(0.1, 1, 130)
    cube = np.tile(light, (1, 90, 1))
    cube[:, 60:] *= 0.1
    path = tmp_path / "lens_0007_irradiance.exr"
    write_exr(SpectralImage(cube, NM, pitch_um=8.459, quantity="irradiance", lens_name="any"), path)
    return path


def test_a_lens_image_becomes_a_raw_file_and_pictures(scene, tmp_path, capsys):
    outputs = [tmp_path / f"shot{suffix}" for suffix in (".dng", ".png", ".exr")]
    assert run("develop", scene, "--camera", "nikon-d700", "--shutter", "1/250", *(
        word for path in outputs for word in ("-o", path)), "--report", tmp_path / "r.json") == 0
    facts = json.loads((tmp_path / "r.json").read_text())["camera"]
    assert facts["shutter_s"] == 1 / 250 and facts["metered"] and facts["raw_px"] == [90, 130]
    out = capsys.readouterr().out
    assert "Nikon D700: 1/250 s at ISO" in out and all(str(path) in out for path in outputs)
    with rawpy.imread(str(outputs[0])) as raw:
        numbers, colours = raw.raw_image.copy(), raw.raw_colors
        assert numbers.shape == (90, 130)
    green = np.where(colours % 2 == 1, numbers - 512.0, np.nan)
    assert np.nanmean(green[:60, 100:]) > 3 * np.nanmean(green[:60, :30])
    assert np.nanmean(green[60:, 100:]) == pytest.approx(0.1 * np.nanmean(green[:60, 100:]), rel=0.1)
    png = np.asarray(Image.open(outputs[1])).astype(float)
    assert png.shape == (90, 130, 3) and np.ptp(png[:60, 20:].mean(axis=(0, 1))) < 4, "daylight is grey"
    _, planes = read_parts(outputs[2])[0]
    assert sorted(planes) == ["B", "G", "R"] and planes["G"][:60].mean() > planes["R"][:60].mean()


def test_frames_share_the_exposure_of_the_first_but_not_its_noise(scene, tmp_path):
    (tmp_path / "lens_0008_irradiance.exr").write_bytes(scene.read_bytes())
    brighter = SpectralImage(np.full((7, 90, 130), 0.01), NM, pitch_um=8.459, quantity="irradiance")
    write_exr(brighter, tmp_path / "lens_0009_irradiance.exr")
    assert run("develop", tmp_path / "lens_####_irradiance.exr", "--camera", "nikon-d700", "-o",
               tmp_path / "m_####.exr", "--mosaic", "--seed", SEED % 2**31, "--report", tmp_path / "r.json") == 0
    mosaics = [read_parts(tmp_path / f"m_{frame:04d}.exr")[0][1]["Y"] for frame in (7, 8, 9)]
    frames = json.loads((tmp_path / "r.json").read_text())["frames"]
    assert len({frame["camera"]["shutter_s"] for frame in frames}) == 1 and frames[2]["camera"]["saturated"] > 0.5
    noise = mosaics[0] - mosaics[1]
    assert 0 < noise.std() < 0.05 and abs(noise.mean()) < 5 * noise.std() / np.sqrt(noise.size)
    again = tmp_path / "again.exr"
    assert run("develop", tmp_path / "lens_0007_irradiance.exr", "--camera", "nikon-d700", "-o", again, "--mosaic",
               "--no-noise") == 0
    assert np.abs(read_parts(again)[0][1]["Y"][:60] - mosaics[0][:60]).mean() < 0.05


def test_a_fade_in_arbitrary_units_stays_a_fade(scene, tmp_path):
    for frame, share in ((1, 1.0), (2, 0.25)):
        picture = replace(read_exr(scene), arbitrary=True)
        write_exr(replace(picture, cube=share * picture.cube), tmp_path / f"fade_{frame}.exr")
    assert run("develop", tmp_path / "fade_#.exr", "--camera", "nikon-d700", "-o", tmp_path / "m_#.exr", "--mosaic",
               "--no-noise") == 0
    first, second = (read_parts(tmp_path / f"m_{frame}.exr")[0][1]["Y"].mean() for frame in (1, 2))
    assert second / first == pytest.approx(0.25, rel=0.02)


@pytest.mark.parametrize("arguments, words", [
    (["--camera", "leica-m3", "-o", "a.dng"], "leica-m3: camera is unknown"),
    (["--camera", "nikon-d700", "-o", "a.jpg"], "suffix is .jpg: expected .dng, .png, .exr"),
    (["--camera", "nikon-d700", "-o", "a.dng", "--mosaic"], "also give an output with the suffix .exr"),
    (["--camera", "generic-three-chip", "-o", "a.exr", "--mosaic"], "pixels of generic-three-chip have all channels"),
    (["--camera", "nikon-d700", "-o", "a.dng", "--shutter", "1/0"], "--shutter is 1/0: expected seconds such as 1/60"),
    (["--camera", "nikon-d700", "-o", "a.dng", "--iso", "fast"], "--iso is fast: expected a positive number"),
    (["--camera", "nikon-d700", "-o", "a.dng", "-o", "a.dng"], "named twice"),
    (["--camera", "nikon-d700", "-o", "a.dng", "--tilt", "1,0"], "--tilt is given: leave it out, or also give"),
    (["--camera", "nikon-d700", "-o", "a.dng", "--which", "2"], "--which is given: leave it out"),
    (["--camera", "nikon-d700", "-o", "a.png", "--lens", "tessar-50mm"], "--lens is tessar-50mm: leave it out: only"),
    (["--camera", "nikon-d700", "-o", "a.dng", "--seed", "-3"], "seed is -3: expected a whole number")])
def test_bad_requests_are_refused_before_any_work(scene, arguments, words, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("develop", scene, *arguments) == 1
    assert words in capsys.readouterr().err
    assert not list(tmp_path.glob("a.*"))


@pytest.mark.parametrize("change, words", [
    ({"filters": ("RR", "GB")}, "camera own: filters is RR/GB: expected a Bayer, Quad Bayer or X-Trans pattern"),
    ({"filters": ("RG",)}, "camera own: channels is RG: expected at least three"),
    ({"pitch_um": 200.0}, "raw picture: size is (4, 5) px: expected at least 12 rows and columns")])
def test_pictures_that_cannot_be_developed_are_refused_before_any_file(scene, change, words, tmp_path, capsys):
    (tmp_path / "own.toml").write_text(camera_text(replace(load_camera("nikon-d700"), name="own", **change)))
    assert run("develop", scene, "--camera", tmp_path / "own.toml", "-o", tmp_path / "a.dng", "-o",
               tmp_path / "a.png") == 1
    assert words in capsys.readouterr().err and not list(tmp_path.glob("a.*"))


def test_a_raw_file_names_the_lens_of_the_picture_and_no_other(scene, tmp_path, capsys):
    lens = load_lens("edmund-54852", quality="preview")
    image = replace(read_exr(scene), lens_name=lens.name, f_number_effective=lens.f_number_effective)
    write_exr(image, scene)
    command = "develop", scene, "--camera", "nikon-d700", "-o"
    assert run(*command, tmp_path / "bare.dng") == 0
    assert run(*command, tmp_path / "full.dng", "--lens", lens.name, "--lens-quality", "preview") == 0
    (bare_tags, bare), (full_tags, full) = (fields(tmp_path / f"{name}.dng") for name in ("bare", "full"))
    for exif in (bare, full):
        assert exif[42036] == lens.name and exif[33437] == pytest.approx(lens.f_number_effective)
    assert full[37386] == pytest.approx(lens.efl_mm) and 50736 in full_tags and 51022 in full_tags
    assert 37386 not in bare and not {50736, 51022} & bare_tags.keys()
    capsys.readouterr()
    assert run(*command, tmp_path / "other.dng", "--lens", "nikkor-58mm-f1.4", "--lens-quality", "preview") == 1
    said = capsys.readouterr()
    assert f"{scene}: lens is edmund-54852: expected nikkor-58mm-f1.4" in said.err and "ISO" not in said.out
    assert not (tmp_path / "other.dng").exists()


def test_a_pitch_serves_the_raw_file_of_a_picture_without_one(scene, tmp_path):
    part = OpenEXR.File(str(scene)).parts[0]
    header = {name: value for name, value in part.header.items() if name != "lensfield:pitchUm"}
    OpenEXR.File(header, part.channels).write(str(tmp_path / "plain.exr"))
    command = "develop", tmp_path / "plain.exr", "--camera", "nikon-d700", "-o", tmp_path / "a.dng"
    assert run(*command) == 1 and run(*command, "--pitch-um", 8.459) == 0


def test_few_wavelengths_and_radiance_are_reported(scene, tmp_path, capsys):
    few = tmp_path / "few.exr"
    write_exr(SpectralImage(np.ones((2, 40, 50)), [500, 560], pitch_um=8.459, quantity="irradiance"), few)
    assert run("develop", few, "--camera", "nikon-d700", "-o", tmp_path / "few.dng") == 0
    out = capsys.readouterr().out
    assert out.index("camera: the wavelengths leave out part of the camera's response") < out.index("few.dng")
    write_exr(SpectralImage(np.ones((2, 40, 50)), [500, 560], pitch_um=8.459), few)
    assert run("develop", few, "--camera", "nikon-d700", "-o", tmp_path / "few.png") == 1
    assert f"{few}: quantity is radiance: expected irradiance" in capsys.readouterr().err


def test_cameras_are_listed_and_inspected(tmp_path, capsys):
    assert run("camera", "list") == 0
    assert len(capsys.readouterr().out.splitlines()) == len(bundled_cameras())
    own = tmp_path / "own.toml"
    own.write_text(camera_text(load_camera("nikon-d700")), encoding="utf-8")
    assert run("camera", "info", own, "--iso", "1600") == 0
    text = capsys.readouterr().out
    assert "36.002 x 23.956 mm, crop factor 1.00" in text and "at ISO 1600" in text
    assert run("camera", "info", own, "--json") == 0
    info = json.loads(capsys.readouterr().out)
    assert info["gain_at_iso_dn_per_e"] == load_camera("nikon-d700").gain_dn_per_e and info["pixels"] == [4256, 2832]


def test_every_field_of_a_camera_is_an_option_of_render_and_apply():
    parser = cli._parser()
    for command in (["render", "s.blend"], ["apply", "r.exr", "--lens", "any"]):
        options = parser.parse_args([*command, "--camera", "x", "--iso", "auto", "--shutter", "1/60", "--no-noise",
                                     "--no-develop", "--dng"])
        none = parser.parse_args([*command, "--camera", "none"])
        assert given_fields(none)["camera"] == ""
        assert (options.camera, options.iso, options.shutter, options.noise, options.develop, options.dng) == (
            "x", "auto", "1/60", False, False, True) and len(CAMERA_FIELDS) == 6
