"""Randomly damaged prescriptions: each yields a lens or a one-line error, and readers print nothing."""

import json
import re
import warnings
from dataclasses import astuple

import numpy as np
import pytest

from lens_texts import SAMPLES, prescriptions
from lensfield.engine import LensError
from lensfield.engine.prescription import prescription
from lensfield.engine.prescription.prescription import Prescription
from lensfield.engine.prescription.readers import READABLE, SUFFIXES, ReadingOptions, read_prescription
from lensfield.engine.prescription.readers.deeplens import read_deeplens

ROUNDS = 150
FIELD = ("angle_deg", 10.0)
SHARDS = [b"0", b"-1", b"1e400", b"nan", b"inf", b"9" * 400, b"1e-320", b"true", b"null", b'"', b"'", b"[", b"{", b";",
          b"&", b"\n", b"\r", b"\0", b"\xff", b"\xc3", "½".encode(), b"S", b"STOP", b"GLAS", b"radius_mm"]


def damaged(data, random):
    """The bytes with one to three changes: truncation, a changed byte, removed or inserted bytes, or a replaced word.
    """
    for _ in range(random.integers(1, 4)):
        at, shard = int(random.integers(len(data) + 1)), SHARDS[random.integers(len(SHARDS))]
        words = data.split(b" ")
        word = int(random.integers(len(words)))
        data = [data[:at], data[:at] + random.bytes(1) + data[at + 1:], data[:at] + data[at + random.integers(1, 30):],
                data[:at] + shard + data[at:], b" ".join([*words[:word], shard, *words[word + 1:]])][random.integers(5)]
    return data


def assert_sound(lens):
    """Figures are numbers, exactly one surface is the stop, and every property can be computed."""
    assert isinstance(lens, Prescription) and lens.surfaces[lens.stop_index].stop
    for surface in lens.surfaces:
        figures = [value for value in astuple(surface) if isinstance(value, int | float)]
        assert not np.isnan([*figures, *surface.aspheric, *surface.odd_aspheric]).any()
        assert isinstance(surface.glass, str) and isinstance(surface.glass_figures, str)
    assert lens.object_distance_mm > 0 and 0 < lens.aperture[1] < np.inf and isinstance(lens.name, str)


kinds = pytest.mark.parametrize("kind", SAMPLES)


def test_every_kind_of_file_has_a_valid_sample():
    assert {f".{kind.rsplit('.', 1)[1]}" for kind in SAMPLES} == set(SUFFIXES)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_help_names_every_kind_of_file(suffix):
    assert re.search(rf"{re.escape(suffix)}\b", READABLE)


@kinds
def test_damage_causes_a_one_line_error_or_another_lens(tmp_path, kind, capfd):
    random = np.random.default_rng(20050501)
    path = tmp_path / f"lens{kind}"
    lenses = 0
    for _ in range(ROUNDS):
        path.write_bytes(damaged(SAMPLES[kind].encode(), random))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                assert_sound(read_prescription(path, ReadingOptions(FIELD)))
                lenses += 1
            except LensError as error:
                assert str(error).startswith(f"{path}: ") and "\n" not in str(error) and len(str(error)) < 600
    assert capfd.readouterr() == ("", "")
    assert lenses < ROUNDS, "the damage did nothing"


@pytest.mark.parametrize("name, text", list(prescriptions(300)), ids=lambda value: value[:14])
def test_files_with_more_than_300_surfaces_are_refused(tmp_path, name, text, monkeypatch):
    """The surfaces are counted before any of them is parsed."""
    (tmp_path / name).write_text(text)
    monkeypatch.setattr(prescription, "_check_surface", None)
    with pytest.raises(LensError, match=r": surfaces is 30[1-9]: expected at most 300$"):
        read_prescription(tmp_path / name, ReadingOptions(FIELD))


def test_a_lens_of_300_surfaces_is_read(tmp_path):
    (_, text), *_ = prescriptions(297)
    (tmp_path / "lens.toml").write_text(text)
    assert len(read_prescription(tmp_path / "lens.toml").surfaces) == 300


def test_surfaces_with_more_than_100_aspheric_terms_are_refused(tmp_path):
    (tmp_path / "lens.json").write_text(SAMPLES["Optiland.json"].replace("0.0001,", "0.0001," * 101, 1))
    with pytest.raises(LensError, match=r": surface 3, aspheric is 10[0-9] terms: expected at most 100$"):
        read_prescription(tmp_path / "lens.json", ReadingOptions(FIELD))


def test_the_time_to_read_deeplens_is_linear_in_its_surfaces(tmp_path):
    """Each surface reads the next one, whatever their number. The test counts, because times depend on the machine."""
    class Counted(list):
        """A list that counts the items that its slices copy."""

        copied = 0

        def __getitem__(self, index):
            result = super().__getitem__(index)
            Counted.copied += len(result) if isinstance(index, slice) else 0
            return result

    *_, (_, text), _ = prescriptions(200)
    contents = json.loads(text)
    contents["surfaces"] = Counted(contents["surfaces"])
    read_deeplens(tmp_path / "lens.json", contents, ReadingOptions(FIELD))
    assert Counted.copied <= len(contents["surfaces"])


@kinds
def test_the_valid_samples_are_lenses(tmp_path, kind):
    (tmp_path / f"lens{kind}").write_text(SAMPLES[kind], encoding="utf-8")
    assert_sound(read_prescription(tmp_path / f"lens{kind}", ReadingOptions(FIELD)))
