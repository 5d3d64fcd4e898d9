"""Resolving a lens name or path, and lenses baked on first use: once, then cached."""

import json
from dataclasses import replace

import numpy as np
import pytest

from forged import forge
from lens_texts import DOT_LENS, TOML, changed
from lensfield.cli import main
from lensfield.engine import LensError, ReadingOptions, read_prescription
from lensfield.engine.bake.quality import QUALITIES, SKETCH
from lensfield.engine.lens_files.package import write_package
from lensfield.engine.library import Rings, baked, clamped_rings, has_rings, load_lens, prescription_of
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.rings import AT_REST
from lensfield.engine.runtime import cache
from refusals import refused

NEAR = Rings(1500.0, 16.0)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty cache folder; bakes are quick and have three wavelengths: caching does not depend on either."""
    monkeypatch.setattr(baked, "WAVELENGTHS_NM", (450, 550, 650))
    monkeypatch.setitem(QUALITIES, "preview", SKETCH)
    monkeypatch.setenv("LENSFIELD_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def bakes(monkeypatch):
    """The prescriptions that are baked instead of read from the cache."""
    prescriptions, bake = [], baked.bake

    def counted(prescription, **options):
        prescriptions.append(prescription)
        return bake(prescription, **options)

    monkeypatch.setattr(baked, "bake", counted)
    return prescriptions


@pytest.fixture
def singlet(tmp_path):
    path = tmp_path / "singlet.toml"
    path.write_text(changed(TOML, ("version = 1", "version = 1\nfocus = 'best'\nstory = 'mine'")))
    return path


def test_a_lens_is_baked_once_and_cached_bit_for_bit(folder, bakes, singlet):
    first, again = (load_lens(singlet, NEAR, "preview") for _ in range(2))
    assert first == again and len(bakes) == 1
    assert cache.size_bytes("lenses")[0] == 1


def test_coatings_share_a_bake(folder, bakes, singlet):
    """Only the transmittance, which records and digests include, depends on them."""
    stated, bare, ideal = (load_lens(singlet, replace(NEAR, coating=name), "preview")
                           for name in (None, "none", "ideal"))
    assert len(bakes) == 1 and len({stated, bare, ideal}) == 3
    np.testing.assert_array_equal(bare.psf, ideal.psf)
    np.testing.assert_array_equal(stated.transmittance, ideal.transmittance)
    assert bare.prescription.coating == "none"
    indices = system_of(bare.prescription).indices_at(bare.wavelengths_nm).max(axis=0)
    fresnel = ((indices - 1) / (indices + 1))**2
    np.testing.assert_allclose(bare.transmittance / ideal.transmittance, (1 - fresnel)**2, rtol=1e-4)


def test_the_bundled_package_has_the_coatings_of_its_prescription():
    package = load_lens("edmund-54852")
    assert package.prescription.coating == "single"
    shares = package.transmittance / system_of(package.prescription).glass_transmittance(package.wavelengths_nm)
    assert shares.argmax() not in (0, shares.size - 1) and 0.75 < shares.min() < shares.max() < 0.97


def test_every_setting_of_a_lens_distinguishes_it_in_the_cache(folder, bakes, singlet):
    cases = [(NEAR, "preview"), (Rings(1600.0, 16.0), "preview"), (Rings(1500.0, 11.0), "preview"),
             (Rings(1500.0, 16.0, True), "preview"), (NEAR, "standard"), (Rings(), "preview")]
    first, *others = (load_lens(singlet, *each) for each in cases)
    assert len(bakes) == len(cases) and first not in others


@pytest.mark.parametrize("picture_nm, baked_nm", [
    (None, baked.WAVELENGTHS_NM), (np.linspace(400, 700, 21), baked.WAVELENGTHS_NM),
    (np.linspace(400, 700, 9), tuple(np.linspace(400, 700, 9))), ([632.8], (632.8,)), ([467, 539], (467, 539)),
    (np.linspace(505, 590, 30), (499, 518, 539, 562, 588, 618)), ([390.0, 550.0], baked.WAVELENGTHS_NM),
    ([550.0, 720.0], baked.WAVELENGTHS_NM), ([np.nan, 550.0], baked.WAVELENGTHS_NM)])
def test_a_bake_has_the_wavelengths_of_the_picture_or_the_fewer_around_them(picture_nm, baked_nm):
    assert baked.needed_wavelengths_nm(picture_nm) == baked_nm


def test_frames_in_the_same_part_of_a_sensor_share_a_bake(folder, bakes, monkeypatch):
    """36 x 24 mm: half a millimetre up and the frame of 3 mm up; a larger shift; a portrait. A radial lens has one bake
    for all."""
    counted = baked.bake
    monkeypatch.setattr(baked, "bake", lambda fixed, **given: counted(fixed, **given | {"quality": SKETCH,
                                                                                       "samples": 17}))
    frames = [(-18.0, -12.0 + up, 18.0, 12.0 + up) for up in (0.5, 3.0, 3.5)] + [(-12.0, -18.0, 12.0, 18.0)]
    lenses = [load_lens("cooke-triplet-50mm", Rings(tilt_deg=(2.0, 0.0)), "preview", wavelengths_nm=[550],
                        edges_mm=each) for each in frames]
    np.testing.assert_allclose([(lens.y_mm[-1], lens.x_mm[-1]) for lens in lenses],
                               [(15.48, 18.72), (15.48, 18.72), (18.48, 18.72), (18.72, 12.48)])
    assert lenses[0] == lenses[1] and len(bakes) == 3
    centred = [load_lens("cooke-triplet-50mm", AT_REST, "preview", wavelengths_nm=[550], edges_mm=each)
               for each in frames]
    assert len(set(centred)) == 1 and len(bakes) == 4


def test_pictures_of_the_same_wavelengths_share_a_bake(folder, bakes, singlet):
    first, again, other = (load_lens(singlet, NEAR, "preview", wavelengths_nm=nm)
                           for nm in ([480.0, 610.0], np.array([480.0, 610.0]), [480.0, 620.0]))
    assert first == again != other and len(bakes) == 2
    assert first.wavelengths_nm.tolist() == [480.0, 610.0]


@pytest.mark.parametrize("picture_nm", [[435.0], [435.0, 480.0, 610.0], np.linspace(430, 690, 7)])
def test_a_lens_does_not_depend_on_the_other_wavelengths_of_its_bake(picture_nm):
    """Off the axis, near, and without a sensor in its file. Heights are chosen anew, so PSFs are compared on the axis
    and at the field's end."""
    prescription = replace(prescription_of("nikkor-28mm"), sensor_mm=None)
    alone, among = (baked.bake(replace(prescription, object_distance_mm=900.0), quality="preview", pitch_um=2.4,
                               samples=65, wavelengths_nm=nm)
                    for nm in (picture_nm, np.union1d(picture_nm, np.linspace(420, 700, 9))))
    for name in ("f_number_effective", "sensor_mm", "efl_mm", "magnification"):
        assert getattr(alone, name) == pytest.approx(getattr(among, name), rel=1e-12)
    for nm in picture_nm:
        one, other = alone.at_wavelength(nm), among.at_wavelength(nm)
        for name in ("real_height_mm", "relative_illumination", "point_flux"):
            assert getattr(one, name)[[0, -1]] == pytest.approx(getattr(other, name)[[0, -1]], rel=1e-4)
        assert one.transmittance == pytest.approx(other.transmittance, rel=1e-12)
        assert np.abs(one.psf[[0, -1]] - other.psf[[0, -1]]).sum(axis=(1, 2)).max() < QUALITIES["preview"].between


def test_another_prescription_of_the_same_name_is_another_lens(folder, bakes, singlet):
    load_lens(singlet, NEAR, "preview")
    singlet.write_text(singlet.read_text().replace("radius_mm = 50.0", "radius_mm = 51.0"))
    load_lens(singlet, NEAR, "preview")
    assert len(bakes) == 2


def test_another_version_of_the_code_bakes_again(folder, bakes, singlet, monkeypatch):
    load_lens(singlet, NEAR, "preview")
    monkeypatch.setattr(cache, "build_identity", lambda: "another")
    load_lens(singlet, NEAR, "preview")
    assert len(bakes) == 2


def test_a_damaged_file_or_a_disabled_cache_only_costs_time(folder, bakes, singlet, monkeypatch):
    lens = load_lens(singlet, NEAR, "preview")
    path, = (folder / "lenses").iterdir()
    path.write_bytes(path.read_bytes()[:-1])
    assert load_lens(singlet, NEAR, "preview") == lens
    monkeypatch.setenv("LENSFIELD_CACHE", "off")
    assert load_lens(singlet, NEAR, "preview") == lens and len(bakes) == 3


def test_a_forged_lens_is_baked_again(folder, bakes, singlet):
    lens = load_lens(singlet, NEAR, "preview")
    for content in (b"junk", b"PK\3\4" + bytes(100)):
        forge(folder, "lenses", content)
        for _ in range(2):
            assert load_lens(singlet, NEAR, "preview") == lens
    assert len(bakes) == 3


def test_another_lens_under_this_name_is_baked_again(folder, bakes, singlet):
    lens = load_lens(singlet, NEAR, "preview")
    path, = (folder / "lenses").iterdir()
    load_lens(singlet, replace(NEAR, f_number=11.0), "preview")
    other, = set((folder / "lenses").iterdir()) - {path}
    path.write_bytes(other.read_bytes())
    assert load_lens(singlet, NEAR, "preview") == lens and len(bakes) == 3


def test_python_sets_rings_by_keywords(singlet):
    lens = load_lens(singlet, Rings(focus_mm=1500, f_number=16.0), quality="preview")
    assert lens == load_lens(singlet, NEAR, "preview")
    assert lens.object_distance_mm + lens.entrance_pupil_mm == pytest.approx(1500)
    with pytest.raises(LensError, match="quality is best: expected preview, standard, reference"):
        load_lens(singlet, quality="best")


def test_a_package_has_no_rings(tmp_path, singlet):
    path = tmp_path / "fixed.npz"
    write_package(load_lens("edmund-54852"), path)
    assert load_lens(path) == replace(load_lens("edmund-54852"), prescription=None) and not has_rings(path)
    with pytest.raises(LensError, match="fixed.npz: focus and f-number is fixed: a package is baked for one of each"):
        load_lens(path, NEAR)


def test_the_bundled_package_matches_its_prescription():
    """Within rounding: another machine's linear algebra fits the wavefront."""
    package, baked_now = load_lens("edmund-54852"), baked.baked_lens(prescription_of("edmund-54852"))
    for name in ("heights_mm", "real_height_mm", "relative_illumination", "wavelengths_nm", "transmittance"):
        np.testing.assert_allclose(getattr(package, name), getattr(baked_now, name), rtol=1e-5, atol=1e-7)
    assert package.psf_pitch_um == baked_now.psf_pitch_um and package.notes == baked_now.notes
    assert np.abs(package.psf - baked_now.psf).sum(axis=(2, 3)).max() < 1e-3


def test_errors_name_the_file(tmp_path):
    path = tmp_path / "unknown.toml"
    path.write_text(changed(TOML, ("SCHOTT N-BK7", "NO-SUCH-GLASS")))
    with refused(LensError, field="surface 2, glass", value="NO-SUCH-GLASS", where="unknown.toml"):
        load_lens(path)
    for text, field in ("format = 'lensfield-prescription'", "version"), ("", "format"), ("\0", "TOML"):
        path.write_text(text)
        with refused(LensError, field=field, where="unknown.toml"):
            load_lens(path)


def test_clamped_rings_are_reported_without_baking(bakes):
    clamped = clamped_rings("tessar-50mm", Rings(f_number=2.0))
    assert clamped == ("f/2 is wider than this lens opens: set to f/5.5",)
    assert clamped_rings("tessar-50mm", NEAR) == () and bakes == []
    assert prescription_of("tessar-50mm").name == "tessar-50mm" and has_rings("tessar-50mm")


@pytest.mark.parametrize("text, shown", [("1.2m", "1200"), ("120 cm", "1200"), ("1200mm", "1200"), ("INF", "infinity")])
def test_the_command_sets_rings(text, shown, folder, singlet, capsys):
    assert main(["lens", "info", str(singlet), "--focus", text, "--f-number", "16", "--lens-quality", "preview"]) == 0
    lens = load_lens(singlet, Rings(float(shown.replace("infinity", "inf")), 16.0), "preview")
    distance = "infinity" if shown == "infinity" else f"{lens.object_distance_mm:g} mm"
    assert f"object distance          {distance}" in capsys.readouterr().out


def test_the_command_prints_the_range_of_the_rings(folder, singlet, capsys):
    assert main(["lens", "info", str(singlet), "--lens-quality", "preview"]) == 0
    assert "focus ring               infinity to 0.4" in (text := capsys.readouterr().out) and "to f/22" in text
    assert main(["lens", "info", str(singlet), "--lens-quality", "preview", "--json"]) == 0
    far, near = json.loads(capsys.readouterr().out)["rings"]
    assert far["focus_mm"] is None and near["f_number"] == 22.0


def test_the_command_prints_the_origin_of_the_figures(folder, singlet, capsys):
    singlet.write_text(changed(singlet.read_text(), (
        "version = 1", 'version = 1\nprovenance = { figures = "patent", stop = "guessed" }')))
    assert main(["lens", "info", str(singlet), "--lens-quality", "preview"]) == 0
    assert "\nfigures                  patent; stop guessed\n" in capsys.readouterr().out
    assert main(["lens", "info", str(singlet), "--lens-quality", "preview", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["provenance"] == {"figures": "patent", "stop": "guessed"}


def test_the_command_reports_clamped_rings(folder, singlet, capsys):
    assert main(["lens", "info", str(singlet), "--focus", "1cm", "--lens-quality", "preview"]) == 0
    words, = clamped_rings(singlet, Rings(10.0))
    assert f"lens: {words}" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["1200", "1.2 miles", "m", "-1m", "0mm", "nanm", "camera"])
def test_invalid_distances_are_errors(text, singlet, capsys):
    assert main(["lens", "info", str(singlet), f"--focus={text}"]) == 1
    assert "--focus is" in capsys.readouterr().err


def test_the_command_shows_and_clears_the_cache(folder, singlet, capsys):
    load_lens(singlet, NEAR, "preview")
    assert main(["lens", "cache"]) == 0 and ": 1 baked lenses, " in capsys.readouterr().out
    assert main(["lens", "cache", "--clear"]) == 0 and ": 0 baked lenses, 0.0 MB" in capsys.readouterr().out
    assert main(["lens", "cache"]) == 0 and str(folder) in capsys.readouterr().out


def test_the_command_lists_lenses_by_words(capsys):
    assert main(["lens", "list", "swirl", "100mm"]) == 0
    assert capsys.readouterr().out.startswith("kodak-petzval-100mm")


def test_a_lens_set_by_rings_is_an_ordinary_lens(singlet):
    lens = load_lens(singlet, NEAR, "preview")
    assert replace(lens) == lens and lens.story == "mine" and lens.mirror_symmetric


def test_options_for_reading_a_file_distinguish_its_lens_in_the_cache(folder, bakes, tmp_path):
    """A field angle of 14 degrees ends at 49.04 mm * tan(14 deg) = 12.23 mm, as an image height of 12.23 mm does."""
    path = tmp_path / "singlet.lens"
    path.write_text(DOT_LENS)
    with refused(LensError, field="field", value="missing", where="singlet.lens"):
        load_lens(path)
    by_angle, by_height, narrow, denser = (
        load_lens(read_prescription(path, ReadingOptions(**given)), NEAR, "preview") for given in (
            {"field": ("angle_deg", 14.0)}, {"field": ("image_height_mm", 12.0)}, {"field": ("angle_deg", 3.0)},
            {"field": ("angle_deg", 14.0), "glasses": ("1.5168/64.2=1.52/64.2",)}))
    assert len(bakes) == 4 and len({lens.digest for lens in (by_angle, by_height, narrow, denser)}) == 4
    assert by_angle.heights_mm[-1] > by_height.heights_mm[-1] > 4 * narrow.heights_mm[-1]
    assert denser.efl_mm == pytest.approx(by_angle.efl_mm * 0.5168 / 0.52, rel=0.01)
    assert load_lens(read_prescription(path, ReadingOptions(("angle_deg", 3.0))), NEAR, "preview") == narrow
    assert len(bakes) == 4
