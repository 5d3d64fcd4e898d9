"""Cryptomatte's ids, against published hashes and the manifests that Blender writes."""

import json

import numpy as np
import pytest

from lensfield.engine.truth.cryptomatte import attributes_of, hash_of, id_of, renamed


@pytest.mark.parametrize("name, expected", [
    ("", 0), ("hello", 0x248BFA47), ("hello, world", 0x149BBB7F),
    ("The quick brown fox jumps over the lazy dog", 0x2E4FF723)])
def test_hashes_are_those_of_murmurhash3(name, expected):
    assert hash_of(name) == expected


@pytest.mark.parametrize("name, expected", [("P\u00fcb", "51fd3437"), ("Sphere", "e5e9b0db"), ("Paint", "56718537"),
                                            ("default_surface", "78d05529")])
def test_ids_are_those_in_blenders_manifests(name, expected):
    assert f"{id_of(name).view(np.uint32):08x}" == expected


def test_every_id_is_a_normal_number():
    """One name in 128 would otherwise not be."""
    bits = np.array([id_of(f"object {number}") for number in range(2000)]).view(np.uint32)
    assert np.all(np.isin(bits >> 23 & 255, (0, 255), invert=True))
    changed = [number for number, value in enumerate(bits) if value != hash_of(f"object {number}")]
    assert 2 < len(changed) < 40
    assert all(int(bits[number]) ^ hash_of(f"object {number}") == 1 << 23 for number in changed)


def test_attributes_are_those_that_blender_writes():
    attributes = attributes_of("ViewLayer.CryptoObject", ["Sphere", "P\u00fcb", "Sphere"])
    assert attributes == {
        "cryptomatte/542cafa/name": "ViewLayer.CryptoObject", "cryptomatte/542cafa/hash": "MurmurHash3_32",
        "cryptomatte/542cafa/conversion": "uint32_to_float32",
        "cryptomatte/542cafa/manifest": '{"P\u00fcb":"51fd3437","Sphere":"e5e9b0db"}'}
    odd = 'a "quoted" name\\'
    manifest, = (text for key, text in attributes_of("Layer", [odd]).items() if key.endswith("/manifest"))
    assert list(json.loads(manifest)) == [odd]


def test_names_are_replaced_and_other_ids_stay():
    names = ["Paint.001", "Glass.001", "Other", ""]
    ids = np.array([[id_of(name) if name else 0 for name in names]], np.float32)
    replaced = renamed(ids, {"Paint.001": "Paint", "Glass.001": "Glass", "Unused.001": "Unused"})
    assert replaced.tolist() == [[id_of("Paint"), id_of("Glass"), id_of("Other"), 0]]
    assert np.array_equal(renamed(ids, {}), ids)
