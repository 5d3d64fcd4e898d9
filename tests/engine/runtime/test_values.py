"""Values: equal contents give equal values, independently of their creator and process; after batoid's `do_pickle`."""

import copy
import pickle
from dataclasses import FrozenInstanceError, fields, replace

import numpy as np
import pytest

from lenses import comatic_lens, make_lens
from lensfield.engine import load_lens
from lensfield.engine.depth.depth_range import check_depth
from lensfield.engine.inspection.finding import LensFinding
from lensfield.engine.lens import RadialLens
from lensfield.engine.pictures.rgb_picture import RgbPicture
from lensfield.engine.runtime import values
from lensfield.engine.spectral.refraction import Formula, Refraction, Table
from lensfield.engine.spectral.spectra import Spectrum, load_spectrum
from lensfield.engine.spectral.wavelength_choice import SpectralOptions, choose_wavelengths
from varied_lenses import varied_lens

NM = np.linspace(400, 700, 31)
LONGEST_REPR = 500


def lens():
    return comatic_lens(name="comatic", maker="a maker", story="a story " * 100, source="a book", notes="none " * 100)


MAKERS = {
    "Lens": lens,
    "MonochromaticLens": lambda: lens().at_wavelength(530.0),
    "LensFinding": lambda: LensFinding("note", "psf", "1", "2"),
    "Spectrum": lambda: Spectrum(NM.copy(), np.linspace(0, 1, 31)),
    "Table": lambda: Table(NM.copy(), np.linspace(1.5, 1.6, 31)),
    "Formula": lambda: Formula(3, (2.25, 0.01, 2.0), (300.0, 900.0)),
    "Refraction": lambda: Refraction("metal", "a book", MAKERS["Formula"](), MAKERS["Table"]()),
    "SpectralOptions": lambda: SpectralOptions(colour_error=0.5),
    "WavelengthChoice": lambda: choose_wavelengths([MAKERS["Spectrum"]().at], [load_spectrum("led-b3").band_means], NM),
    "RgbPicture": lambda: RgbPicture(np.full((60, 80, 3), 0.5, np.float32), (2, 3), "ViewLayer.Combined"),
    "DepthCheck": lambda: check_depth(np.full((4, 5), 1000.0), lens(), 5.0),
}
kinds = pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS.keys())


def arrays(value):
    return {field.name: held for field in fields(value) if isinstance(held := getattr(value, field.name), np.ndarray)}


def changed(held):
    """The smallest change of a field's contents: the last bit of the last sample, a letter, a bit of a number."""
    if isinstance(held, np.ndarray):
        held = held.copy()
        held.flat[-1] = np.nextafter(held.flat[-1], np.inf, dtype=held.dtype)
        return held
    if isinstance(held, tuple):
        return *held[:-1], changed(held[-1])
    if isinstance(held, str):
        return held + "."
    if isinstance(held, float):
        return np.nextafter(held, 2 * held + 1)
    return Formula(1, (1.0,), (1.0, 2.0))


@kinds
def test_equal_contents_give_equal_values(make):
    value, other = make(), make()
    assert value is not other and value == other and hash(value) == hash(other) and len({value, other}) == 1
    assert value not in (None, repr(value), lens().scaled(2.0))


@kinds
def test_a_value_survives_pickling_and_copying(make):
    value = make()
    hash(value)  # derived data must not be trusted afterwards
    for other in (pickle.loads(pickle.dumps(value)), copy.copy(value), copy.deepcopy(value)):
        assert other is not value and other == value and hash(other) == hash(value) and repr(other) == repr(value)
        for array in arrays(other).values():
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0


@kinds
def test_a_value_has_a_short_repr_that_names_it(make):
    shown = repr(make())
    assert shown.startswith(f"{type(make()).__name__}(") and len(shown) <= LONGEST_REPR and "\n" not in shown


@kinds
def test_a_value_cannot_be_changed(make):
    value = make()
    with pytest.raises(FrozenInstanceError):
        setattr(value, fields(value)[0].name, None)


@pytest.mark.parametrize("kind", ["MonochromaticLens", "Spectrum", "Table", "Formula", "Refraction", "WavelengthChoice",
                                  "RgbPicture"])
def test_any_change_gives_a_different_value(kind):
    value = MAKERS[kind]()
    assert hash(value) == hash(MAKERS[kind]())
    for field in fields(value):
        other = replace(value, **{field.name: changed(getattr(value, field.name))})
        assert other != value and hash(other) != hash(value), field.name
        assert replace(other, **{field.name: getattr(value, field.name)}) == value


@pytest.mark.parametrize("field", [field.name for field in fields(RadialLens)])
def test_any_change_gives_a_different_lens(field):
    before = lens()
    hash(before)
    if field == "psf":  # which must preserve unit sums
        other = replace(before, psf=before.psf.swapaxes(2, 3))
    elif field == "transmittance":
        other = replace(before, transmittance=[1.0, np.nextafter(1.0, 0.0)])
    else:
        other = replace(before, **{field: changed(getattr(before, field))})
    assert other != before and hash(other) != hash(before)


def test_lenses_loaded_twice_are_equal_even_with_unknown_values():
    unknown = replace(lens(), enclosed_energy=np.full((2, 6), np.nan))
    assert unknown == replace(lens(), enclosed_energy=np.full((2, 6), np.nan)) and unknown != lens()
    assert load_lens("edmund-54852") == load_lens("edmund-54852") != varied_lens("tessar-50mm")


@pytest.mark.parametrize("efl_mm", [10, 10.0, np.float64(10), np.int64(10)])
def test_equal_numbers_are_equal_whatever_their_type(efl_mm):
    assert make_lens(efl_mm=efl_mm) == make_lens(efl_mm=10.0)


def test_values_of_different_kinds_differ():
    assert Spectrum(NM, NM) != Table(NM, NM)


def test_arrays_of_different_shapes_or_types_differ():
    square = RgbPicture(np.zeros((4, 4, 3), np.float32), (0, 0), "")
    assert replace(square, rec709=np.zeros((2, 8, 3), np.float32)) != square
    assert replace(square, rec709=np.zeros((4, 4, 3), np.int32)) != square


def test_the_memory_layout_of_an_array_does_not_matter():
    table = np.random.default_rng(0).random((5, 7, 3))
    assert RgbPicture(table, (0, 0), "") == RgbPicture(np.asfortranarray(table), (0, 0), "")
    assert RgbPicture(table[::2], (0, 0), "") == RgbPicture(table[::2].copy(), (0, 0), "")


def test_nothing_is_digested_before_values_are_compared(monkeypatch):
    monkeypatch.setattr(values, "digest_of", None)
    first = lens()
    assert first == first and first.scaled(2.0).at_wavelength(500.0) and repr(first)
    with pytest.raises(TypeError):
        hash(first)


@pytest.mark.parametrize("held", [[1.0], {1: 2}, object()])
def test_mutable_contents_have_no_digest(held):
    with pytest.raises(TypeError, match="has no digest"):
        values.digest_of((1.0, held))
