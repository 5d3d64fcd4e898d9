"""What the surfaces of layers belong to, from Cryptomatte's ranks."""

import numpy as np
import pytest

from lensfield.engine.truth.mattes import MISSED_PX, Mattes, names_in_files, shares_of_surfaces

IDS = np.array([[[7, 7, 9, 0, 0, 0, 0]], [[9, 0, 5, 0, 0, 0, 0]]], np.uint32)
WEIGHTS = np.array([[[0.5, 0.8, 0.3, 0, 0, 0, 0]], [[0.25, 0, 0.3, 0, 0, 0, 0]]], np.float32)
OWNERS = {7: "Hat", 9: "Coat"}


ALPHA = np.array([[0.9, 0.8, 0.6, 0, 0, 0, 0]], np.float32)


def test_surfaces_share_all_of_an_alpha_and_continue_a_little():
    ids, shares = shares_of_surfaces(IDS, WEIGHTS, ALPHA, opaque=False)
    np.testing.assert_allclose(shares, [[2 / 3, 1, 0.5, 0.5, 0.5, 0, 0], [1 / 3, 0, 0.5, 0.5, 0.5, 0, 0],
                                        [0, 0, 0, 0, 0, 1, 1]], rtol=1e-6)
    assert ids[0, :5].tolist() == [7, 7, 9, 9, 9]
    ids, met = np.full((1, 2, 14), 7, np.uint32), np.arange(14) < np.array([[2], [2]])
    _, shares = shares_of_surfaces(ids, met[None].astype(np.float32), met.astype(np.float32), opaque=False, times=2)
    np.testing.assert_array_equal(shares[0].reshape(2, 14)[0], np.arange(14) < 2 + 2 * MISSED_PX)


def test_the_background_of_an_opaque_layer_has_the_rest():
    _, shares = shares_of_surfaces(IDS, WEIGHTS, ALPHA, opaque=True)
    np.testing.assert_allclose(shares[:, 0], [0.6, 0.3, 0.1], rtol=1e-6)
    np.testing.assert_allclose(shares.sum(axis=0), 1, rtol=1e-6)


def test_the_parts_of_a_pixel_have_its_alpha_together():
    """A pixel that a surface covers on the left, and a half of which two surfaces share below."""
    ids = np.array([[[7, 0], [7, 9]]], np.uint32)
    alpha = np.array([[1, 0], [1, 0.5]], np.float32)
    _, shares = shares_of_surfaces(ids, alpha[None], alpha, opaque=False, times=2)
    np.testing.assert_allclose(shares, [[1.6, 0, 1.6, 0.8], [0, 0, 0, 0]], rtol=1e-6)


def test_owners_are_the_same_in_all_layers():
    layers = [shares_of_surfaces(IDS[..., :end], WEIGHTS[..., :end], ALPHA[..., :end], opaque=False) for end in (7, 2)]
    mattes = Mattes.of(layers, OWNERS, {})
    assert mattes.owners == ("00000005", "Coat", "Hat")  # an id without a name
    assert [share.shape for share in mattes.shares] == [(4, 7), (4, 2)]
    np.testing.assert_allclose(mattes.shares[0].toarray()[:3, :3], [[0, 0, 0.5], [1 / 3, 0, 0.5], [2 / 3, 1, 0]])
    assert mattes.shares[0].toarray()[3].tolist() == [0, 0, 0, 0, 0, 1, 1]
    nothing = np.zeros((1, 1, 4))
    empty = Mattes.of([shares_of_surfaces(nothing.astype(np.uint32), nothing, nothing[0], opaque=True)], OWNERS, {})
    assert empty.owners == () and empty.shares[0].toarray().tolist() == [[1, 1, 1, 1]]


def test_masks_add_up_their_members_and_are_not_black():
    mattes = Mattes(("Coat", "Hat", "Tree"), (), {"Clothes": ["Coat", "Hat"], "Hats": ["Hat"], "Plants": ["Tree"]})
    coverage = np.zeros((4, 1, 2), np.float32)
    coverage[:2, 0, 0] = 0.25, 0.5
    coverage[3] = 1 - coverage.sum(axis=0)
    masks = dict(mattes.masks(coverage))
    assert list(masks) == ["Background", "Clothes", "Hats"]
    assert masks["Clothes"].tolist() == [[0.75, 0]] and masks["Background"].tolist() == [[0.25, 1]]
    names = [name for name, _ in Mattes(("Background", "Hat", "Tree"), ()).masks(coverage)]
    assert names == ["Background", "Background", "Hat"], "an object may have any name"
    assert names_in_files(names) == ["Background", "Background_002", "Hat"]


@pytest.mark.parametrize("names, expected", [
    (["Cube", "Cube.001", "Cube_001"], ["Cube", "Cube_001", "Cube_001_002"]),
    (["a" * 80, "a" * 70], ["a" * 63, "a" * 59 + "_002"]),
    (["\u00e4" * 40, "B\u00e4ll"], ["\u00e4" * 31, "B\u00e4ll"])])
def test_names_in_files_are_different_short_and_without_dots(names, expected):
    assert names_in_files(names) == expected
