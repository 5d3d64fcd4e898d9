"""`lensfield lens import`: the kind of a path, and the bundled lens through every kind of export and back."""

import numpy as np
import pytest

from lensfield.cli import main
from lensfield.engine import LensError, load_lens
from lensfield.engine.lens_files import import_lens
from refusals import refused
from vendor_files import (
    EXPORTS,
    check_same_lens,
    export_folder,
    exported_lens,
    fft_listing,
    huygens_listing,
    iset_bundle,
    matrix_text,
    ray_trace,
    saved,
    upright,
    zospy_json,
)


@pytest.fixture
def lens():
    return exported_lens()


def bundled_lens():
    """The bundled lens at some of its wavelengths and heights, declared evenly spaced like bundled heights."""
    lens = load_lens("edmund-54852")
    heights, waves = slice(None, None, lens.heights_mm.size // 4), slice(None, None, lens.wavelengths_nm.size // 2)
    of_both = {name: getattr(lens, name)[waves, heights] for name in ("relative_illumination", "psf")}
    nm, real = lens.wavelengths_nm[waves], lens.real_height_mm[waves, heights]
    return exported_lens(
        wavelengths_nm=nm, heights_mm=np.linspace(0, 3, real.shape[1]), real_height_mm=lambda nm, height: real,
        relative_illumination=lambda nm, height: of_both["relative_illumination"], psf=of_both["psf"],
        **{name: getattr(lens, name) for name in ("efl_mm", "magnification", "f_number_effective", "object_distance_mm",
                                                  "entrance_pupil_mm", "psf_pitch_um", "reference_wavelength_nm")})


@pytest.mark.parametrize("kind", EXPORTS)
def test_the_bundled_lens_round_trips_through_every_export(tmp_path, kind):
    lens = bundled_lens()
    path = EXPORTS[kind](tmp_path, lens)
    read = import_lens(path)
    check_same_lens(read, lens)
    assert read.mirror_symmetric and read.psf.shape[-1] == (lens.psf.shape[-1] - 1) // 2 * 2 + 1
    for field in ("efl_mm", "magnification", "f_number_effective", "object_distance_mm", "reference_wavelength_nm"):
        assert getattr(read, field) == pytest.approx(getattr(lens, field), rel=1e-4), field
    assert read.capture_focal_length_mm == pytest.approx(lens.capture_focal_length_mm, rel=1e-4)
    v_um = (np.arange(read.psf.shape[-1]) - read.psf.shape[-1] // 2) * read.psf_pitch_um
    assert np.abs(read.psf.sum(axis=3) @ v_um).max() > 1  # asymmetric enough to detect PSFs turned the wrong way


def test_ffts_of_different_pitch_are_resampled_to_one(tmp_path, lens):
    """Pitches grow with the wavelength, as in FFT PSFs; listings count their centre from the top."""
    path = iset_bundle(tmp_path, lens)
    wide = {}
    for w, nm in enumerate(lens.wavelengths_nm):
        pitch = 0.25 * nm / 450
        x = (np.arange(64) - 31) * pitch
        for h in range(3):
            wide[w] = np.exp(-(x[:, None] + h) ** 2 / 4 - x**2 / 2)  # leans down by h um: outwards, below the axis
            listing = fft_listing(wide[w], pitch, nm, -lens.real_height_mm[w, h])
            (tmp_path / f"LENS_PSF_{h + 1}_{w + 1}.dat").write_text(listing, encoding="latin-1")
    read = import_lens(path)
    assert read.psf_pitch_um == pytest.approx(0.25)
    v = (np.arange(read.psf.shape[-1]) - read.psf.shape[-1] // 2) * 0.25
    np.testing.assert_allclose(read.psf.sum(axis=3) @ v, [[0, 1, 2]] * 2, atol=1e-3)


@pytest.mark.parametrize("export", ["ISET bundle", "export folder of zemax", "Code V bundle"])
def test_a_folder_and_its_description_give_the_same_lens(tmp_path, lens, export):
    path = EXPORTS[export](tmp_path / "Ordner Ä", lens)
    by_file, by_folder = import_lens(path), import_lens(str(path.parent))
    np.testing.assert_array_equal(by_file.psf, by_folder.psf)
    assert by_file.name == by_folder.name


def test_an_export_takes_precedence_over_a_bundle_in_its_folder(tmp_path, lens):
    iset_bundle(tmp_path, lens)
    export_folder(tmp_path, lens)
    assert import_lens(tmp_path).name == "Tessar ½"


def test_a_name_may_be_given(tmp_path, lens):
    assert import_lens(iset_bundle(tmp_path, lens), name="my lens").name == "my lens"


@pytest.mark.parametrize("name, text", [
    ("PSF_1_1.dat", lambda psf: huygens_listing(psf, 0.5, 450, -1)), ("psf.txt", lambda psf: matrix_text(psf)),
    ("psf.json", lambda psf: zospy_json(psf, 0.5))])
def test_the_error_for_a_single_listing_names_the_missing_data(tmp_path, lens, name, text):
    (tmp_path / name).write_text(text(upright(lens.psf[0, 0], "-y")), encoding="utf-8")
    with pytest.raises(LensError, match=f"{name}.*single listing.*first-order data.*relative illumination.*lens.toml"):
        import_lens(tmp_path / name)


@pytest.mark.parametrize("name", ["absent", "x" * 5000, "nul\0byte", "", "lens.zmx", "lens.npz", "lens.mat",
                                  "lens.toml"])
def test_missing_or_unsupported_files_are_errors(tmp_path, name):
    if name.startswith("lens"):
        (tmp_path / name).write_text("VERS 1")
    with pytest.raises(LensError) as error:
        import_lens(str(tmp_path / name) if name else "")
    assert "\n" not in str(error.value)


def test_the_error_for_an_empty_folder_names_the_expected_files(tmp_path):
    with refused(LensError, field="folder", value="without a description", match="ISETPARMS.TXT.*lens.toml.*.mat"):
        import_lens(tmp_path)


def test_the_error_for_loading_an_export_names_the_import_command(tmp_path, lens):
    saved(tmp_path / "optics.mat", ray_trace(lens))
    for path in (iset_bundle(tmp_path, lens), export_folder(tmp_path, lens), tmp_path / "optics.mat", tmp_path):
        with pytest.raises(LensError, match="lensfield lens import"):
            load_lens(path)


def test_the_command_writes_a_package(tmp_path, lens, capsys):
    path, target = iset_bundle(tmp_path / "Bündel", lens), tmp_path / "out" / "lens.npz"
    assert main(["lens", "import", str(path.parent), "-o", str(target), "--name", "Größe 6"]) == 0
    printed = capsys.readouterr().out
    assert str(target) in printed and "Transmittance assumed to be 1" in printed
    read = load_lens(target)
    assert read.name == "Größe 6" and read.notes.split("\n")[0] in printed
    assert main(["lens", "info", str(target)]) == 0


@pytest.mark.parametrize("output", ["lens.zip", "lens", "."])
def test_the_command_refuses_output_that_could_not_be_loaded(tmp_path, lens, capsys, output):
    assert main(["lens", "import", str(iset_bundle(tmp_path, lens)), "-o", str(tmp_path / output)]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_a_failed_import_leaves_no_file(tmp_path, capsys):
    assert main(["lens", "import", str(tmp_path), "-o", str(tmp_path / "lens.npz")]) == 1
    assert "without a description" in capsys.readouterr().err and list(tmp_path.iterdir()) == []
