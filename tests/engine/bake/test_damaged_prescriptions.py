"""Prescriptions damaged at random: each is a lens or an error of one line, and no reader says a word."""

import warnings
from dataclasses import astuple

import numpy as np
import pytest

from lens_texts import CODEV, PBRT, TOML, ZEMAX, saved_by_optiland
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


@pytest.fixture(scope="module")
def sound_files(tmp_path_factory):
    texts = {".toml": TOML, ".zmx": ZEMAX, ".seq": CODEV, ".dat": PBRT}
    json = saved_by_optiland(tmp_path_factory.mktemp("sound") / "lens.json").read_bytes()
    return {kind: text.encode() for kind, text in texts.items()} | {".json": json}


@pytest.mark.parametrize("kind", READERS)
def test_damage_makes_an_error_of_one_line_or_another_lens(sound_files, tmp_path, kind, capfd):
    random = np.random.default_rng(20050501)
    path = tmp_path / f"lens{kind}"
    lenses = 0
    for _ in range(ROUNDS):
        path.write_bytes(damaged(sound_files[kind], random))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                assert_sound(read_prescription(path, FIELD))
                lenses += 1
            except LensError as error:
                assert str(error).startswith(f"{path}: ") and "\n" not in str(error) and len(str(error)) < 600
    assert capfd.readouterr() == ("", "")
    assert lenses < ROUNDS, "the damage did nothing"


@pytest.mark.parametrize("kind", READERS)
def test_the_sound_files_are_lenses(sound_files, tmp_path, kind):
    (tmp_path / f"lens{kind}").write_bytes(sound_files[kind])
    assert_sound(read_prescription(tmp_path / f"lens{kind}", FIELD))
