"""Prescriptions damaged at random: each is a lens or an error of one line, and no reader says a word."""

import json
import warnings
from dataclasses import astuple

import numpy as np
import pytest

from lens_texts import CODEV, DEEPLENS, DOT_LENS, LENTIL, OPTBENCH, PBRT, TOML, ZEMAX, optiland
from lensfield.engine import LensError
from lensfield.engine.bake.prescription import Prescription
from lensfield.engine.bake.prescriptions import READERS, read_prescription

ROUNDS = 150
FIELD = ("angle_deg", 10.0)
SHARDS = [b"0", b"-1", b"1e400", b"nan", b"inf", b"9" * 400, b"1e-320", b"true", b"null", b'"', b"'", b"[", b"{", b";",
          b"&", b"\n", b"\r", b"\0", b"\xff", b"\xc3", "½".encode(), b"S", b"STOP", b"GLAS", b"radius_mm"]


def damaged(data, random):
    """The bytes with one to three hurts: cut off, one byte another, some gone, a shard put in, or in a word's place."""
    for _ in range(random.integers(1, 4)):
        at, shard = int(random.integers(len(data) + 1)), SHARDS[random.integers(len(SHARDS))]
        words = data.split(b" ")
        word = int(random.integers(len(words)))
        data = [data[:at], data[:at] + random.bytes(1) + data[at + 1:], data[:at] + data[at + random.integers(1, 30):],
                data[:at] + shard + data[at:], b" ".join([*words[:word], shard, *words[word + 1:]])][random.integers(5)]
    return data


def assert_sound(lens):
    """Figures are numbers, one surface is the stop, and all of it can be asked for."""
    assert isinstance(lens, Prescription) and lens.surfaces[lens.stop_index].stop
    for surface in lens.surfaces:
        figures = [value for value in astuple(surface) if isinstance(value, int | float)]
        assert not np.isnan([*figures, *surface.aspheric, *surface.odd_aspheric]).any()
        assert isinstance(surface.glass, str) and isinstance(surface.glass_figures, str)
    assert lens.object_distance_mm > 0 and 0 < lens.aperture[1] < np.inf and isinstance(lens.name, str)


FILES = {".toml": TOML, ".zmx": ZEMAX, ".seq": CODEV, ".dat": PBRT, ".txt": OPTBENCH, ".lens": DOT_LENS,
         "_optiland.json": json.dumps(optiland(), indent=1), "_deeplens.json": json.dumps(DEEPLENS, indent=1),
         "_lentil.json": json.dumps(LENTIL, indent=1)}
kinds = pytest.mark.parametrize("kind", FILES)


def test_there_is_a_sound_file_of_every_kind():
    assert {f".{kind.rsplit('.', 1)[1]}" for kind in FILES} == set(READERS)


@kinds
def test_damage_makes_an_error_of_one_line_or_another_lens(tmp_path, kind, capfd):
    random = np.random.default_rng(20050501)
    path = tmp_path / f"lens{kind}"
    lenses = 0
    for _ in range(ROUNDS):
        path.write_bytes(damaged(FILES[kind].encode(), random))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                assert_sound(read_prescription(path, FIELD))
                lenses += 1
            except LensError as error:
                assert str(error).startswith(f"{path}: ") and "\n" not in str(error) and len(str(error)) < 600
    assert capfd.readouterr() == ("", "")
    assert lenses < ROUNDS, "the damage did nothing"


@pytest.mark.parametrize("kind, old, new", [
    (".toml", "[[surfaces]]", "[[surfaces]]\nthickness_mm = 1\n" * 1001 + "[[surfaces]]"),
    (".zmx", "SURF 3", "SURF 2\n CURV 0\n DISZ 1\n" * 1001 + "SURF 3"),
    ("_optiland.json", "0.0001,", "0.0001," * 101)], ids=["toml", "zmx", "terms"])
def test_lenses_of_more_surfaces_than_anybody_makes_are_told_before_they_are_traced(tmp_path, kind, old, new):
    path = tmp_path / f"lens{kind}"
    path.write_text(FILES[kind].replace(old, new, 1))
    with pytest.raises(LensError, match="surfaces is .*: expected at most 1000 and 100"):
        read_prescription(path, FIELD)


@kinds
def test_the_sound_files_are_lenses(tmp_path, kind):
    (tmp_path / f"lens{kind}").write_text(FILES[kind], encoding="utf-8")
    assert_sound(read_prescription(tmp_path / f"lens{kind}", FIELD))
