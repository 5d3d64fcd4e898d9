"""Invalid values: each is rejected where the value is created, in one line with the field and the value."""

import json
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lens_texts import DEEPLENS, optiland
from lenses import make_lens
from lensfield.engine import ImageError, InputError, LensError, SpectralImage
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.iris import Iris
from lensfield.engine.lens_files.package import read_package, write_package
from lensfield.engine.lens_files.psf_grid import PsfGrid
from lensfield.engine.library import load_lens
from lensfield.engine.pictures.deep_exr import DeepPicture
from lensfield.engine.prescription.prescription import Prescription, Surface
from lensfield.engine.spectral.spectra import Spectrum

NAN, INF = np.nan, np.inf
GRID = PixelGrid((5, 7), 6.0, (1.2, 4.5), (1, 1))


def with_last(table, value):
    changed = np.array(table, float)
    changed.flat[-1] = value
    return changed


def rejects(make, error, *words):
    with warnings.catch_warnings(), pytest.raises(error) as raised:
        warnings.simplefilter("error")
        make()
    text = str(raised.value)
    assert "\n" not in text and all(word in text for word in words), text


@pytest.mark.parametrize("value", [NAN, INF, -INF, -1.0, 0.0])
@pytest.mark.parametrize("field", ["wavelengths_nm", "real_height_mm"])
def test_the_tables_of_a_lens(field, value):
    lens = make_lens(wavelengths_nm=(450.0, 650.0))
    rejects(lambda: replace(lens, **{field: with_last(getattr(lens, field), value)}), LensError, field)


@pytest.mark.parametrize("changes, words", [
    ({"wavelengths_nm": [-650.0, -450.0]}, ("wavelengths_nm is [-650.0, -450.0]", "positive nanometres")),
    ({"wavelengths_nm": [0.0, 450.0]}, ("wavelengths_nm is [0.0, 450.0]",)),
    ({"wavelengths_nm": [650.0, 450.0]}, ("wavelengths_nm", "ascending")),
    ({"sensor_mm": (20.0, NAN)}, ("sensor_mm", "positive width and height")),
    ({"sensor_mm": (NAN, 20.0)}, ("sensor_mm",)),
    ({"transmittance": [0.0, 0.0]}, ("transmittance is 0 at all wavelengths",))])
def test_figures_of_a_lens(changes, words):
    rejects(lambda: replace(make_lens(wavelengths_nm=(450.0, 650.0)), **changes), LensError, *words)


@pytest.mark.parametrize("field", ["relative_illumination", "point_flux"])
def test_a_lens_without_light_on_the_axis(field):
    lens = make_lens()
    rejects(lambda: replace(lens, **{field: 0 * getattr(lens, field)}), LensError, field, "0 on the axis")


@pytest.mark.parametrize("member, change, words", [
    ("wavelengths_nm", lambda table: -table[::-1], ("wavelengths_nm", "positive nanometres")),
    ("wavelengths_nm", lambda table: with_last(table, NAN), ("wavelengths_nm", "not finite")),
    ("real_height_mm", lambda table: with_last(table, -2.5), ("real_height_mm is -2.5 at 650 nm", "paraxial height"))])
def test_a_package_of_such_tables_is_rejected_with_its_file(tmp_path, member, change, words):
    write_package(make_lens(wavelengths_nm=(450.0, 650.0)), tmp_path / "whole.npz")
    with zipfile.ZipFile(tmp_path / "whole.npz"), np.load(tmp_path / "whole.npz") as archive:
        members = {name: archive[name] for name in archive.files}
    np.savez(tmp_path / "changed.npz", **(members | {member: change(members[member])}))
    rejects(lambda: read_package(tmp_path / "changed.npz"), LensError, "changed.npz", *words)


@pytest.mark.parametrize("alpha", [NAN, INF, -INF, 2.0, 1.01, -1.0, -0.01])
def test_the_alpha_of_a_layer(alpha):
    rejects(lambda: Layer(np.ones((2, 5, 7)), with_last(np.ones((5, 7)), alpha), np.full((5, 7), 300.0)), ImageError,
            "layer: alpha at 4 6 is", "from 0 to 1")


@pytest.mark.parametrize("depth_mm", [NAN, -INF, -300.0, 0.0])
def test_the_depth_of_a_layer(depth_mm):
    depths_mm = with_last(np.full((5, 7), 300.0), depth_mm)
    rejects(lambda: Layer(np.ones((2, 5, 7)), np.ones((5, 7)), depths_mm), ImageError,
            "depth_mm at row 4, column 6", "positive number, or inf")
    nowhere = Layer(np.ones((2, 5, 7)), with_last(np.ones((5, 7)), 0.0), depths_mm)
    np.testing.assert_array_equal(nowhere.depth_mm, depths_mm.astype(np.float32))  # where the layer is empty


def test_rounding_errors_of_alpha_are_clipped():
    layer = Layer(np.ones((1, 1, 3)), [[-1e-5, 0.5, 1 + 1e-5]], np.full((1, 3), INF))
    assert layer.alpha.tolist() == [[0.0, 0.5, 1.0]]


@pytest.mark.parametrize("origin_px", [(NAN, 0), (0.5, 0), (0, INF), (1,), 3])
def test_the_origin_of_a_layer(origin_px):
    rejects(lambda: Layer(np.ones((1, 2, 2)), np.ones((2, 2)), np.ones((2, 2)), origin_px), ImageError, "origin_px")


@pytest.mark.parametrize("field, value", [
    *(("wavelengths_nm", nm) for nm in ((NAN, 600), (500, INF), (-600, -500), (0, 500), (600, 500), (500, 500))),
    *(("focal_mm", value) for value in (NAN, INF, -50.0, 0.0)), *(("exposure", value) for value in (NAN, INF, -1.0))])
def test_captures(field, value):
    """Of layers and of one picture."""
    layer, figures = Layer(np.ones((2, 5, 7)), np.ones((5, 7)), np.full((5, 7), INF)), {"wavelengths_nm": (500, 600)}
    rejects(lambda: LayeredRadiance([layer], grid=GRID, **(figures | {field: value})), ImageError, field)
    rejects(lambda: SpectralImage(np.ones((2, 5, 7)), grid=GRID, **(figures | {field: value})), ImageError, field)


@pytest.mark.parametrize("field", ["shape_px", "overscan_px"])
@pytest.mark.parametrize("value", [(5, NAN), (INF, 7), (5, 7.5)])
def test_counts_of_pixels(field, value):
    rejects(lambda: replace(GRID, **{field: value}), ImageError, field)


@pytest.mark.parametrize("alpha", [NAN, 2.0, -1.0])
def test_the_alpha_of_deep_samples(alpha):
    rejects(lambda: DeepPicture((2, 3), (0, 0), "", np.arange(3), np.ones(3), np.array([0.5, alpha, 1]),
                                np.ones((3, 3))), ImageError, "alpha at 1 is")


@pytest.mark.parametrize("nm, values", [
    ([400, 500], [1, NAN]), ([400, 500], [1, INF]), ([400, 500], [-1, 1]), ([500, 400], [1, 1]), ([400, 400], [1, 1]),
    ([-500, -400], [1, 1]), ([0, 400], [1, 1]), ([400, NAN], [1, 1]), ([400, 500], [1]), ([], []), ([[400]], [[1]])])
def test_spectra(nm, values):
    rejects(lambda: Spectrum(np.array(nm, float), np.array(values, float)), InputError, "spectrum")


@pytest.mark.parametrize("blades", [5.5, NAN, INF, -5, 2])
def test_blades(blades):
    rejects(lambda: Iris(blades), InputError, "iris: blades is")


@pytest.mark.parametrize("changes", [
    {"wavelength_nm": NAN}, {"wavelength_nm": -550.0}, {"wavelength_nm": 0.0}, {"image_mm": (NAN, 0.0)},
    {"image_mm": (0.0, INF)}, {"values": np.ones(5)}])
def test_psf_grids(changes):
    rejects(lambda: PsfGrid(**({"where": Path("psf.txt"), "values": np.ones((5, 5)), "pitch_um": 1.0, "centre": (2, 2)}
                               | changes)), LensError, "psf.txt: PSF")


@pytest.mark.parametrize("field, value", [
    ("radius_mm", 1e-300), ("radius_mm", NAN), ("radius_mm", 0.0), ("thickness_mm", 1e300), ("thickness_mm", NAN),
    ("thickness_mm", INF), ("semi_aperture_mm", 1e-300), ("semi_aperture_mm", -1.0), ("semi_aperture_mm", NAN),
    ("conic", NAN), ("conic", INF)])
def test_surfaces(field, value):
    surfaces = [Surface(50.0, 3.0, "1.5/60", 9.0, stop=True), Surface(-50.0, 40.0)]
    surfaces[0] = replace(surfaces[0], **{field: value})
    rejects(lambda: Prescription("one", tuple(surfaces), ("stop", 5.0), ("angle_deg", 10.0)), LensError, "surface 1")


@pytest.mark.parametrize("contents", [optiland(), DEEPLENS], ids=["Optiland", "DeepLens"])
def test_a_json_lens_of_negative_focal_length(tmp_path, contents):
    """With the signs of all curvatures reversed."""
    contents = json.loads(json.dumps(contents))
    rows = contents.get("surfaces") or [row["geometry"] for row in contents["surface_group"]["surfaces"]]
    for row in rows:
        for name in {"roc", "c", "(c)", "radius"} & row.keys():
            row[name] = -row[name]
    (tmp_path / "lens.json").write_text(json.dumps(contents))
    rejects(lambda: load_lens(tmp_path / "lens.json"), LensError, "lens.json: focal length is -",
            "expected a lens of positive power")
