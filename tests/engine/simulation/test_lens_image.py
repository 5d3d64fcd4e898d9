"""The lens image with its stray light, on a frame that is neither square nor centred."""

from dataclasses import replace

import numpy as np
import pytest

from lenses import make_lens, tinted
from lensfield.engine import ImageError, InputError, LensError, Options, Report, SpectralImage, simulate
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.sources import Sources
from lensfield.engine.lens.iris import Iris, opening
from lensfield.engine.pictures.spectral_exr import read_exr, read_parts, read_stray, read_with_layers, write_exr
from lensfield.engine.runtime import scratch
from lensfield.engine.simulation.lens_image import StrayFacts, lens_image
from lensfield.engine.stray.ghost_table import ghost_table
from lensfield.engine.stray.options import StrayOptions
from lensfield.engine.stray.star import star_share
from lensfield.engine.stray.stray_light import stray_light
from refusals import refused
from varied_lenses import varied_lens

NM = [450.0, 550.0, 650.0]
OPTIONS = Options(accuracy=0.02)
VEIL = StrayOptions("veil", glare_index=5.0)


def radiance(cube=None):
    if cube is None:
        cube = np.random.default_rng(7).random((3, 40, 60))
    return SpectralImage(cube, NM, pitch_um=60.0, overscan_px=(2, 3), centre_px=(15.0, 37.0), focal_mm=11.0)


def test_the_lens_image_is_the_sum_of_light_and_stray_light():
    """Each wavelength of the light loses the share that is scattered."""
    light, lens, report = radiance(), make_lens(), Report()
    image, stray = lens_image(light, lens, OPTIONS, VEIL, report=report)
    without = simulate(light, lens, OPTIONS)
    kept = (image.cube - stray.cube).sum(axis=(1, 2), keepdims=True) / without.cube.sum(axis=(1, 2), keepdims=True)
    assert np.all((kept > 0.5) & (kept < 0.99))
    np.testing.assert_allclose(image.cube, kept * without.cube + stray.cube, rtol=1e-5)
    assert stray.grid == image.grid == without.grid and image.frame_px == (36, 54)
    facts = report.parts.of(StrayFacts)
    assert facts.shares["veil"] == pytest.approx(stray.cube.sum() / without.cube.sum(), rel=1e-5)
    assert 0.03 < facts.shares["veil"] < 0.3
    assert report.as_dict()["stray_light"]["shares"] == facts.shares


@pytest.mark.parametrize("stray", [StrayOptions("star"), StrayOptions("veil,star", glare_index=5.0)])
def test_the_lens_image_loses_the_light_of_its_stars(stray):
    """At each wavelength, the share that the stop diffracts beyond the PSFs; with a veil, that in addition."""
    lens, iris = tinted(make_lens(np.ones((41, 41)) / 41**2, psf_pitch_um=5.0, f_number_effective=8.0)), Iris(5, 10.0)
    light = radiance()
    without = simulate(light, lens, OPTIONS, iris=iris)

    def remaining(stray):
        image, added = lens_image(light, lens, OPTIONS, stray, iris=iris)
        kept = (image.cube.astype(float) - added.cube).sum(axis=(1, 2)) / without.cube.sum(axis=(1, 2), dtype=float)
        np.testing.assert_allclose(image.cube, kept[:, None, None] * without.cube + added.cube, rtol=1e-4)
        return kept

    share = star_share(lens, opening(iris, lens), np.array(NM))
    assert share.min() > 1e-3 and np.ptp(share) > 0.1 * share.max()
    scattered = 1 - remaining(VEIL) if "veil" in stray.stray_light else 0
    np.testing.assert_allclose(1 - remaining(stray) - scattered, share, atol=3e-6)


def test_light_out_of_focus_has_wide_stars():
    lens, iris, stray = make_lens(np.ones((41, 41)) / 41**2, psf_pitch_um=5.0), Iris(5, 10.0), StrayOptions("star")
    lamp = np.zeros((3, 40, 60), np.float32)
    lamp[:, 18, 22] = 100
    light = radiance(lamp)
    layers = LayeredRadiance((Layer(lamp, lamp[0].clip(0, 1), np.full((40, 60), 30.0)),), NM, light.grid)
    _, added = lens_image(light, lens, OPTIONS, stray, layers=layers, iris=iris)
    wide, narrow = (stray_light(light, lens, stray, OPTIONS.accuracy, layers=each, iris=iris).cube
                    for each in (layers, None))
    assert wide.max() < 0.8 * narrow.max()
    np.testing.assert_array_equal(added.cube, wide)


def test_the_predicted_light_of_sources_beyond_the_picture_falls_with_their_cosine():
    """A part below the accuracy is predicted from the light through the pupil, whose area a source sees foreshortened.
    """
    lens, light = tinted(make_lens()), radiance()

    def predicted(direction, lens=lens):
        sun = Sources(np.array([direction]), np.array([np.inf]), np.full((1, 3), 1e-2), NM, np.zeros(1), ("sun",))
        return stray_light(light, lens, StrayOptions(glare_index=0.5), 0.09, outside=sun).predicted["veil"]

    alone, behind = stray_light(light, lens, StrayOptions(glare_index=0.5), 0.09).predicted["veil"], [0.6, 0.0, -0.8]
    steep, oblique = (predicted(direction) - alone for direction in ([0.6, 0.0, 0.8], [0.0, -0.96, 0.28]))
    assert predicted(behind) == pytest.approx(alone) and oblique > 0.01 * alone
    assert steep / oblique == pytest.approx(0.8 / 0.28, rel=1e-6)
    clear, grey = (predicted([0.6, 0.0, 0.8], make_lens(transmittance=share)) for share in (1.0, 0.4))
    assert grey == pytest.approx(clear, rel=1e-6), "the glass absorbs all light alike"


def test_non_finite_pixels_are_refused_or_replaced():
    light = radiance()
    light.cube[1, 20, 30] = np.nan
    with refused(ImageError, field="pixel at row 20, column 30, 550 nm", value="nan", where="image"):
        lens_image(light, make_lens(), OPTIONS, VEIL)
    _, stray = lens_image(light, make_lens(), Options(accuracy=0.02, fireflies="clamp"), VEIL)
    np.testing.assert_allclose(stray.cube, lens_image(radiance(), make_lens(), OPTIONS, VEIL)[1].cube, rtol=1e-2)


def test_black_pictures_have_no_stray_light():
    image, stray = lens_image(radiance(np.zeros((3, 40, 60))), make_lens(), OPTIONS, VEIL)
    assert not stray.cube.any() and not image.cube.any()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("stray", [VEIL, StrayOptions()])
def test_a_sun_beyond_a_black_picture_is_all_of_its_light(stray):
    sun = Sources(np.array([[0.6, 0.0, 0.8]]), np.array([np.inf]), np.ones((1, 3)), NM, np.zeros(1), ("sun",))
    report = Report()
    image, light = lens_image(radiance(np.zeros((3, 40, 60))), make_lens(), OPTIONS, stray, outside=sun, report=report)
    assert light.cube.any() and np.array_equal(image.cube, light.cube)
    assert sum(report.parts.of(StrayFacts).shares.values()) == pytest.approx(1)


@pytest.mark.parametrize("accuracy, glare_index, computed", [
    (0.1, 20.0, False), (0.05, 20.0, True), (0.05, 1.0, False)])
def test_auto_computes_what_exceeds_the_accuracy_and_states_the_rest(accuracy, glare_index, computed):
    """Nothing is considered at the accuracy of previews."""
    report, options = Report(), StrayOptions(glare_index=glare_index)
    image, stray = lens_image(radiance(), make_lens(), Options(accuracy=accuracy), options, report=report)
    facts = report.parts.of(StrayFacts)
    assert (stray is not None) == computed and (facts is None) == (accuracy == 0.1)
    if not computed:
        np.testing.assert_array_equal(image.cube, simulate(radiance(), make_lens(), Options(accuracy=accuracy)).cube)
    if facts and not computed:
        assert facts.predicted["veil"] < 0.05 and any("below the accuracy" in line for line in report.remarks())


def test_the_stray_light_is_a_layer_of_the_file(tmp_path):
    """Readers of the first part see the sum; the layer has the same channels."""
    image, stray = lens_image(radiance(), make_lens(), OPTIONS, VEIL)
    write_exr(image, tmp_path / "with.exr", stray=stray)
    write_exr(image, tmp_path / "without.exr")
    for path in (tmp_path / "with.exr", tmp_path / "without.exr"):
        read, planes, layers = read_with_layers(path)
        assert np.array_equal(read.cube, image.cube) and read.grid == image.grid and layers is None
        assert np.array_equal(read_exr(path).cube, image.cube)
    layer = read_stray(tmp_path / "with.exr")
    np.testing.assert_allclose(layer.cube, stray.cube, rtol=2.0**-16)
    assert layer.grid == stray.grid
    assert layer.quantity == "irradiance" and layer.lens_name == image.lens_name
    assert read_stray(tmp_path / "without.exr") is None
    (first, channels), (second, others) = read_parts(tmp_path / "with.exr")
    assert (first["name"], second["name"]) == ("irradiance", "stray") and channels.keys() == others.keys()


def test_stray_light_of_large_pictures_is_in_a_file_like_the_irradiance(tmp_path):
    light = radiance()
    stored = scratch.new_array(light.cube.shape, tmp_path)
    stored[:] = light.cube
    image, stray = lens_image(radiance(stored), make_lens(), OPTIONS, VEIL)
    assert scratch.in_file(stray.cube) and scratch.in_file(image.cube)
    np.testing.assert_array_equal(stray.cube, lens_image(light, make_lens(), OPTIONS, VEIL)[1].cube)


@pytest.mark.parametrize("given, message", [
    ({"stray_light": "ghosts,bloom"}, "bloom: expected auto, off, or some of ghosts, veil, star"),
    ({"stray_light": ""}, "expected auto, off"), ({"cleanliness": "filthy"}, "new or dusty or hazy"),
    ({"glare_index": 60.0}, "glare_index"), ({"neglected": float("nan")}, "neglected")])
def test_invalid_options_are_one_line(given, message):
    with pytest.raises(InputError, match=message):
        StrayOptions(**given)


def lamp(lens):
    cube = np.full((3, 40, 60), 0.01)
    cube[:, 8:10, 44:46] = 1e4
    return SpectralImage(cube, NM, pitch_um=lens.sensor_mm[0] / 60 * 1e3, focal_mm=lens.capture_focal_length_mm)


def test_the_surfaces_of_a_lens_cause_ghosts_of_lamps():
    """Six bare surfaces of indices of about 1.62 reflect 5.6 % each, and 15 pairs less than 0.056^2 each."""
    lens, report = varied_lens("cooke-triplet-50mm"), Report()
    image, stray = lens_image(lamp(lens), lens, OPTIONS, StrayOptions("ghosts"), report=report)
    facts = report.parts.of(StrayFacts)
    assert 0.002 < facts.shares["ghosts"] < 15 * 0.06**2 and facts.sources >= 1
    assert {surface for first, second, _ in facts.pairs for surface in (first, second)} <= set(range(1, 8))
    assert facts.neglected < 0.02 * facts.shares["ghosts"] and np.all(stray.cube <= image.cube * 1.001)
    _, without = lens_image(lamp(lens), lens, OPTIONS, StrayOptions("star"))
    assert without.cube.sum() < stray.cube.sum()


def test_lenses_without_ghosts_are_reported_with_the_remedy():
    ideal = varied_lens("cooke-triplet-50mm")
    ideal = replace(ideal, prescription=ideal.prescription.coated("ideal"))
    for lens, remedy in ((make_lens(), "use a prescription"), (ideal, "--coating")):
        report = Report()
        _, stray = lens_image(lamp(lens), lens, OPTIONS, StrayOptions("ghosts"), report=report)
        assert stray is None and any(remedy in line for line in report.remarks())


def test_the_table_of_ghosts_is_for_the_same_surfaces_and_light():
    lens = varied_lens("cooke-triplet-50mm")
    table = ghost_table(lens, 10.0)
    shares = [row.share for row in table.rows]
    assert 0.003 < table.total < 15 * 0.06**2 and 0.8 * table.total < sum(shares) <= table.total * 1.001
    assert shares == sorted(shares, reverse=True) and table.irradiance.shape == (240, 360)
    assert all(abs(row.x_mm) < 0.05 * row.radius_mm for row in table.rows), "the source is above the axis"
    with refused(LensError, field="ghosts", value="none", where="hand-made"):
        ghost_table(make_lens(), 10.0)
