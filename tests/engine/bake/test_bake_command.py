"""`lensfield lens bake`, on Thorlabs' achromatic doublet AC254-050-A behind a stop: small, fast requests."""

import json
import os
import pickle
import subprocess
import sys
from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

import lensfield.commands.bake as command
from lens_texts import DOT_LENS, OPTBENCH, ZEMAX, changed
from lenses import make_lens
from lensfield import cli
from lensfield.engine import LensError, load_lens
from lensfield.engine.lens import RadialLens
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.prescription.readers import read_prescription

DOUBLET = """
format = "lensfield-prescription"
version = 1
name = "doublet"
source = "Thorlabs AC254-050-A"
aperture = { f_number = 8.0 }
field = { angle_deg = 5.0 }
focus = "best"

[[surfaces]]
thickness_mm = 2.0
stop = true

[[surfaces]]
radius_mm = 33.3
thickness_mm = 9.0
glass = "SCHOTT N-BAF10"

[[surfaces]]
radius_mm = -22.3
thickness_mm = 2.5
glass = "SCHOTT N-SF10"

[[surfaces]]
radius_mm = -291.1
thickness_mm = 43.4
"""
LAST = "thickness_mm = 43.4\n"
TINY = ("--heights", 2, "--wavelengths", 550, "--samples", 17, "--pitch", 2)


def run(*arguments):
    return cli.main(["lens", "bake", *map(str, arguments)])


@pytest.fixture
def path(tmp_path):
    (tmp_path / "doublet.toml").write_text(DOUBLET)
    return tmp_path / "doublet.toml"


@pytest.fixture
def requests(monkeypatch):
    """The bake that the command requests, without running it."""
    requests = []

    def bake(prescription, **request):
        requests.append(SimpleNamespace(prescription=prescription, **request))
        return make_lens()

    monkeypatch.setattr(command, "bake_lens", bake)
    return requests


@pytest.fixture(scope="module")
def baked(tmp_path_factory):
    """The lens from a single bake that sets many of the options."""
    folder = tmp_path_factory.mktemp("baked")
    (folder / "doublet.toml").write_text(DOUBLET)
    assert run(folder / "doublet.toml", "-o", folder / "new" / "lens.npz", "--heights", 3, "--wavelengths",
               "450,550,650", "--samples", 33, "--workers", 1, "--f-number", 10, "--field-height", 4, "--sensor",
               "6.4x4.8", "--name", "one of two lenses", "--glass", "N-SF10=SF10") == 0
    assert [file.name for file in (folder / "new").iterdir()] == ["lens.npz"]
    return load_lens(folder / "new" / "lens.npz")


def test_the_package_records_the_request(baked):
    assert (baked.name, baked.source, baked.sensor_mm) == ("one of two lenses", "Thorlabs AC254-050-A", (6.4, 4.8))
    assert baked.wavelengths_nm.tolist() == [450, 550, 650] and baked.psf.shape == (3, 3, 33, 33)
    assert baked.heights_mm[0] == 0 and baked.real_height_mm[1, -1] == pytest.approx(4.0, rel=5e-3), "the corner"


def test_first_order_figures_match_the_makers(baked):
    assert baked.efl_mm == pytest.approx(50.0, abs=0.15)
    assert baked.f_number_effective == pytest.approx(10.0, rel=5e-3)
    assert baked.entrance_pupil_mm == pytest.approx(0.0, abs=1e-9), "the stop is the first surface"
    assert baked.magnification == 0 and np.isinf(baked.object_distance_mm)


def test_heights_reach_from_the_axis_to_the_end(baked):
    assert np.all(np.diff(baked.heights_mm) > 0)
    np.testing.assert_allclose(baked.real_height_mm, np.broadcast_to(baked.heights_mm, (3, 3)), rtol=5e-3)


def test_the_chosen_pitch_encloses_the_light(baked):
    assert 0.995 <= baked.enclosed_energy.min() < 0.9975 and baked.enclosed_energy.max() <= 1
    assert float(f"{baked.psf_pitch_um:.2g}") == baked.psf_pitch_um
    np.testing.assert_allclose(baked.psf.sum(axis=(2, 3)), 1, atol=1e-5)


def test_the_chief_ray_lands_in_the_middle(baked):
    axis = baked.psf[:, 0].astype(float)
    for mirrored in (axis[:, ::-1], axis[:, :, ::-1], axis.transpose(0, 2, 1)):
        np.testing.assert_allclose(axis, mirrored, atol=2e-4 * axis.max())
    assert all(np.unravel_index(psf.argmax(), psf.shape) == (16, 16) for psf in axis)
    np.testing.assert_array_equal(baked.psf, baked.psf[..., ::-1])


def test_illumination_falls_with_the_fourth_power_of_the_cosine(baked):
    """Except for the doublet's distortion and the cones that its field curvature widens: 2 %."""
    cosine = np.cos(np.arctan(baked.heights_mm / baked.efl_mm))
    np.testing.assert_allclose(baked.relative_illumination, np.broadcast_to(cosine**4, (3, 3)), atol=0.02)
    assert np.all(baked.relative_illumination[:, 0] == 1)


def test_the_glass_absorbs_some_blue(baked):
    assert 0.9 < baked.transmittance[0] < baked.transmittance[1] < 1


def test_a_set_of_object_distances_shares_one_focus(tmp_path, path, capfd):
    """Focused at 20 m, it blurs infinity to a disc of EFL^2 / (20 m - EFL) / N: 15.7 um across."""
    path.write_text(changed(DOUBLET, ("version = 1", "version = 1\nobject_distance_mm = 20000.0")))
    assert run(path, "-o", tmp_path / "lens.npz", "--object-distance", "20000,inf", "--heights", 2, "--field-angle", 1,
               "--wavelengths", 550, "--samples", 33, "--pitch", 1.5) == 0
    assert sorted(file.name for file in tmp_path.glob("*.npz")) == ["lens_20000mm.npz", "lens_inf.npz"]
    near, far = (load_lens(tmp_path / f"lens_{name}.npz") for name in ("20000mm", "inf"))
    assert (near.object_distance_mm, far.object_distance_mm) == (20000, np.inf)
    assert near.magnification == pytest.approx(-near.efl_mm / (20000 - near.efl_mm), rel=2e-3)
    assert far.magnification == 0 and far.efl_mm == near.efl_mm

    def mean_square_um2(lens):
        offset_um = (np.arange(33) - 16) * lens.psf_pitch_um
        return (lens.psf[0, 0] * (offset_um[:, None]**2 + offset_um**2)).sum()

    disc_um = 1e3 * near.efl_mm**2 / (20000 - near.efl_mm) / 8
    assert mean_square_um2(far) - mean_square_um2(near) == pytest.approx((disc_um / 2)**2 / 2, rel=0.15)
    out, err = capfd.readouterr()
    first, summary, second, _ = out.splitlines()
    assert (err, first, second) == ("", str(tmp_path / "lens_20000mm.npz"), str(tmp_path / "lens_inf.npz"))
    assert "f = 50." in summary and "PSFs of 33 x 33 samples of 1.5 um contain at least" in summary


def test_two_threads_bake_the_same_lens_as_one(tmp_path, path):
    for workers in (1, 2):
        assert run(path, "-o", tmp_path / f"{workers}.npz", *TINY, "--workers", workers) == 0
    one, two = (load_lens(tmp_path / f"{workers}.npz") for workers in (1, 2))
    for field in fields(RadialLens):
        before, after = getattr(one, field.name), getattr(two, field.name)
        assert before == after if isinstance(before, str) else np.array_equal(before, after), field.name


def test_a_failed_bake_prints_nothing_more_as_its_process_ends(path, tmp_path):
    """Python's helper processes, which outlive the bake, print nothing either."""
    path.write_text(changed(DOUBLET, ('focus = "best"', ""), (LAST, LAST + "semi_aperture_mm = 1.0\n")))
    command = [sys.executable, "-c", "from lensfield.cli import console; console()", "lens", "bake", path,
               "-o", tmp_path / "lens.npz", *TINY, "--f-number", 16, "--field-angle", 20]
    process = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    assert (process.returncode, process.stdout, process.stderr.count("\n")) == (1, "", 1), process.stderr
    assert "no light passes" in process.stderr


def test_no_light_at_the_end_of_the_field_is_one_line_that_names_the_file(path, tmp_path, capfd):
    """The chief ray passes the stop at 20 degrees, and the rim of the last surface blocks all light."""
    path.write_text(changed(DOUBLET, ('focus = "best"', ""), (LAST, LAST + "semi_aperture_mm = 1.0\n")))
    assert run(path, "-o", tmp_path / "lens.npz", *TINY, "--f-number", 16, "--field-angle", 20, "--workers", 1) == 1
    out, err = capfd.readouterr()
    assert err.startswith(f"lensfield: {path}: field height is 18.") and "no light passes the apertures" in err
    assert out == "" and err.count("\n") == 1 and [file.name for file in tmp_path.iterdir()] == ["doublet.toml"]


@pytest.mark.parametrize("error, status, message", [
    (KeyboardInterrupt, 130, "lensfield: cancelled"),
    (LensError("a lens", "field height", "3 mm", "end it"), 1, "doublet.toml: field height is 3 mm: end it"),
    (MemoryError("no room"), 1, "lensfield: no room"), (OSError("disk full"), 1, "lensfield: disk full")], ids=str)
def test_an_interrupted_bake_leaves_nothing_behind(path, tmp_path, monkeypatch, capfd, error, status, message):
    def bake(*_, **__):
        raise error

    monkeypatch.setattr(command, "bake_lens", bake)
    assert run(path, "-o", tmp_path / "lens.npz") == status
    out, err = capfd.readouterr()
    assert message in err and err.count("\n") == 1 and out == ""
    assert [file.name for file in tmp_path.iterdir()] == ["doublet.toml"]


def test_a_lens_error_passes_between_processes():
    error = LensError("lens.toml", "field", 3.5, "end it")
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is LensError and str(copy) == str(error) == "lens.toml: field is 3.5: end it"


@pytest.mark.parametrize("arguments, field, value", [
    (("--f-number", "11"), "aperture", ("f_number", 11.0)), (("--image-plane", "paraxial"), "focus", "paraxial"),
    (("--field-angle", "3"), "field", ("angle_deg", 3.0)), (("--field-height", "3"), "field", ("image_height_mm", 3.0)),
    (("--sensor", "36X24"), "sensor_mm", (36.0, 24.0)), (("--name", "mine"), "name", "mine"), ((), "focus", "best")])
def test_the_command_line_overrides_the_file(path, tmp_path, requests, arguments, field, value):
    assert run(path, "-o", tmp_path / "lens.npz", *arguments) == 0
    assert getattr(requests[0].prescription, field) == value


@pytest.mark.parametrize("pairs, glasses", [
    (["N-SF10=F2"], ["", "SCHOTT N-BAF10", "F2", ""]),
    (["SCHOTT N-SF10 = 1.7/30"], ["", "SCHOTT N-BAF10", "1.7/30", ""]),
    (["N-SF10=N-BAF10", "N-BAF10=N-SF10"], ["", "N-SF10", "N-BAF10", ""])])
def test_glasses_are_substituted(path, tmp_path, requests, pairs, glasses):
    assert run(path, "-o", tmp_path / "lens.npz", *(word for pair in pairs for word in ("--glass", pair))) == 0
    assert [surface.glass for surface in requests[0].prescription.surfaces] == glasses


def test_an_object_distance_keeps_the_focus(path, tmp_path, requests):
    assert run(path, "-o", tmp_path / "lens.npz", "--object-distance", 500) == 0
    prescription = requests[0].prescription
    assert (prescription.object_distance_mm, prescription.focus) == (500, "as given")
    assert prescription.surfaces[-1].thickness_mm == pytest.approx(43.4, abs=0.2)
    assert load_lens(tmp_path / "lens.npz").name == "hand-made"


def test_the_focus_ring_is_turned(path, tmp_path, requests, capsys):
    assert run(path, "-o", tmp_path / "lens.npz", "--focus", "0.8m") == 0
    prescription = requests[0].prescription
    assert prescription.object_distance_mm == pytest.approx(800, abs=10) and prescription.focus == "as given"
    assert prescription.surfaces[-1].thickness_mm == pytest.approx(43.4 + 50**2 / 750, abs=0.5)
    assert run(path, "-o", tmp_path / "lens.npz", "--focus", "1cm") == 0
    assert "lens: focus at 0.01 m: " in capsys.readouterr().err


def test_a_bundled_lens_is_baked_by_its_name(tmp_path, requests):
    assert run("tessar-50mm", "-o", tmp_path / "lens.npz", "--field-height", 10) == 0
    assert (requests[0].prescription.name, requests[0].prescription.field) == ("tessar-50mm", ("image_height_mm", 10.0))


def test_the_request_and_its_defaults(path, tmp_path, requests):
    assert run(path, "-o", tmp_path / "a.npz") == 0
    assert run(path, "-o", tmp_path / "b.npz", *TINY, "--workers", 1) == 0
    first, second = requests
    assert first.quality == "standard"
    assert [first.heights, first.samples, first.pitch_um, first.workers] == 4 * [None]
    assert first.wavelengths_nm.tolist() == np.linspace(400, 700, 31).tolist()
    assert (second.heights, second.samples, second.pitch_um, second.workers) == (2, 17, 2.0, 1)


@pytest.mark.parametrize("arguments, message", [
    ("--f-number 0", "doublet.toml: aperture, f_number is 0.0"),
    ("--f-number nan", "doublet.toml: aperture, f_number is nan"),
    ("--field-angle 95", "doublet.toml: field, angle_deg is 95.0: expected less than 90"),
    ("--field-height -1", "doublet.toml: field, image_height_mm is -1.0"),
    ("--sensor 36", "options: --sensor is 36: expected WIDTHxHEIGHT in mm, such as 36x24"),
    ("--sensor 36x0", "options: --sensor is 36x0: expected WIDTHxHEIGHT"),
    ("--sensor=", "options: --sensor is empty: expected WIDTHxHEIGHT"),
    ("--glass F2=SF2", "doublet.toml: --glass is F2=SF2: expected OLD=NEW with one of SCHOTT N-BAF10, SCHOTT N-SF10"),
    ("--glass N-SF10=", "doublet.toml: --glass is N-SF10=: expected OLD=NEW"),
    ("--glass N-SF10", "doublet.toml: --glass is N-SF10: expected OLD=NEW"),
    ("--glass =N-SF10", "doublet.toml: --glass is =N-SF10: expected OLD=NEW"),
    ("--glass N-SF10=LAK10C", "doublet.toml: surface 3, glass is LAK10C"),
    ("--glass N-SF10=1.72", "doublet.toml: surface 3, glass is 1.72: an index without dispersion: give its Abbe number "
                            "too, as 1.72/V (--glass OLD=NEW)"),
    ("--object-distance far", "options: --object-distance is far: expected distances in mm, or inf"),
    ("--object-distance 5,,6", "options: --object-distance is 5,,6: expected distances in mm, or inf"),
    ("--object-distance 500,500", "options: --object-distance is 500,500: expected each distance once"),
    ("--object-distance 0", "doublet.toml: object_distance_mm is 0.0"),
    ("--object-distance nan", "doublet.toml: object_distance_mm is nan"),
    ("--wavelengths 650,450", "options: wavelengths is 650,450: expected first:last:number"),
    ("--heights 1", "doublet.toml: heights is 1: expected at least 2"),
    ("--samples 16", "doublet.toml: samples is 16: expected an odd number"),
    ("--pitch 0", "doublet.toml: pitch is 0.0: expected a positive number of um"),
    ("--pitch nan", "doublet.toml: pitch is nan: expected a positive number of um"),
    ("--workers 0", "options: --workers is 0: expected at least 1"),
    ("--workers -3", "options: --workers is -3: expected at least 1"),
    ("-o lens.png", "lens.png: suffix is .png: expected .npz"),
    ("-o lens", "lens: suffix is missing: expected .npz")])
def test_bad_values_give_one_line_and_leave_nothing_behind(path, tmp_path, capfd, arguments, message):
    assert run(path, "-o", tmp_path / "lens.npz", *arguments.split()) == 1
    out, err = capfd.readouterr()
    assert message in err and err.startswith("lensfield: ") and err.count("\n") == 1 and out == ""
    assert [file.name for file in tmp_path.iterdir()] == ["doublet.toml"]


@pytest.mark.parametrize("arguments", ["--image-plane sharp", "--quality best", "--heights 2.5", "--f-number x",
                                       "--field-angle 5 --field-height 3"])
def test_usage_errors_are_status_2(path, tmp_path, arguments, capsys):
    assert run(path, "-o", tmp_path / "lens.npz", *arguments.split()) == 2
    assert f"argument {arguments.split()[-2]}: " in capsys.readouterr().err


@pytest.mark.parametrize("name, message", [("doublet.toml/lens.npz", "folder is impossible to create"),
                                           ("folder.npz", "file is a folder"), ("pipe.npz", "a device or pipe")])
def test_a_file_that_cannot_be_written_is_refused_before_the_work(path, tmp_path, requests, capfd, name, message):
    (tmp_path / "folder.npz").mkdir()
    os.mkfifo(tmp_path / "pipe.npz")
    assert run(path, "-o", tmp_path / name) == 1
    assert message in capfd.readouterr().err and not requests


@pytest.mark.parametrize("contents", ["format = 1", "\0", DOUBLET[:200]])
def test_an_invalid_or_missing_file_is_named(path, tmp_path, capfd, contents):
    path.write_text(contents)
    assert run(path, "-o", tmp_path / "lens.npz") == 1
    assert run(tmp_path / "no.zmx", "-o", tmp_path / "lens.npz") == 1
    first, second = capfd.readouterr().err.splitlines()
    assert first.startswith(f"lensfield: {path}: ") and "no.zmx: prescription is missing" in second


def test_another_programs_prescription_is_converted(path, capsys):
    (path.parent / "seq.txt").write_text(OPTBENCH)
    target = path.parent / "new" / "lens.toml"
    assert cli.main(["lens", "convert", str(path.parent / "seq.txt"), "-o", str(target), "--f-number", "8",
                     "--glass", "1.5168/64.2=N-BK7", "--name", "a singlet"]) == 0
    assert capsys.readouterr().out == f"{target}\n"
    lens = read_prescription(target)
    assert (lens.name, lens.aperture, lens.surfaces[1].glass) == ("a singlet", ("f_number", 8.0), "N-BK7")
    assert replace(lens, name="seq", aperture=("f_number", 9.8)).with_glasses({"N-BK7": "1.5168/64.2"}) == (
        read_prescription(path.parent / "seq.txt"))


@pytest.mark.parametrize("output, message", [
    ("lens.txt", "suffix is .txt: expected .toml"),
    ("doublet.toml", "file is one of the inputs: use a different name for each output")])
def test_a_prescription_does_not_overwrite_another(path, capsys, output, message):
    before = path.read_text()
    assert cli.main(["lens", "convert", str(path), "-o", str(path.parent / output)]) == 1
    assert message in capsys.readouterr().err and path.read_text() == before


def convert(path, *arguments):
    return cli.main(["lens", "convert", str(path), "-o", str(path.parent / "new.toml"), *arguments])


def test_a_file_that_contradicts_itself_is_converted_only_on_request(path, capsys):
    lens = path.parent / "wrong.lens"
    lens.write_text(changed(DOT_LENS, ("focal_length: 49.00", "focal_length: 60.0")))
    assert convert(lens, "--field-height", "5") == 1 and not (path.parent / "new.toml").exists()
    assert "focal length is 60 mm, and its surfaces give 49.04 mm" in capsys.readouterr().err
    assert convert(lens, "--field-height", "5", "--allow-mismatch") == 0
    assert "notes: " in capsys.readouterr().err
    ours = read_prescription(path.parent / "new.toml")
    assert ours.focal_length_mm is None and "The file's focal length is 60 mm, and its surfaces give" in ours.notes


def test_glasses_are_substituted_before_the_focal_length_is_compared(path, capsys):
    """Crown replaced by dense flint is a different lens, to which the file's figure does not apply."""
    (path.parent / "seq.txt").write_text(OPTBENCH)
    assert convert(path.parent / "seq.txt", "--glass", "1.5168/64.2=1.7/30") == 1
    assert "focal length is 49 mm, and its surfaces give 36." in capsys.readouterr().err


@pytest.mark.parametrize("arguments, semi_mm", [((), 7.5), (("--semi-diameters", "aperture"), 7.5),
                                                (("--semi-diameters", "ignore"), np.inf)])
def test_fixed_semi_diameters_on_the_command_line(path, capsys, arguments, semi_mm):
    (path.parent / "lens.zmx").write_text(changed(ZEMAX, ("8.0 1 0 0 1 \"\"\n  FLAP 0 8.0 0", "7.5 1 0 0 1 \"\"")))
    assert convert(path.parent / "lens.zmx", *arguments) == 0
    assert read_prescription(path.parent / "new.toml").surfaces[1].semi_aperture_mm == semi_mm
    assert "semi-diameters" in capsys.readouterr().err
    assert convert(path, "--semi-diameters", "ignore") == 1
    assert "only Zemax files have semi-diameters in addition to apertures: leave it out" in capsys.readouterr().err


def check(*arguments):
    return cli.main(["lens", "check", *map(str, arguments)])


def test_prescriptions_are_checked_by_their_rays(path, capsys):
    assert check("sonnar-50mm-f1.5") == 0
    assert capsys.readouterr().out == "no findings\n"
    text = changed(DOUBLET, ("focus =", "focal_length_mm = 80\nfocus ="))
    path.write_text(text)
    assert check(path) == 1
    assert "error: focal_length_mm: 80 mm, and the surfaces give 50.1 mm" in capsys.readouterr().out
    assert check(path, "--json") == 1
    assert json.loads(capsys.readouterr().out)[0]["field"] == "focal_length_mm"


def test_a_field_is_given_for_a_file_without_one(path, capsys):
    (path.parent / "doublet.lens").write_text(DOT_LENS)
    assert check(path.parent / "doublet.lens") == 1
    assert "give --field-angle or --field-height" in capsys.readouterr().err
    assert check(path.parent / "doublet.lens", "--field-height", 5) == 0
    assert "no findings" in capsys.readouterr().out
    write_package(make_lens(), path.parent / "lens.npz")
    assert check(path.parent / "lens.npz", "--field-height", 5) == 1
    assert "lens.npz: --field-height is 5.0: applies to prescription files only" in capsys.readouterr().err
