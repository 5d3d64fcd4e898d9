"""Mattes: what the surfaces in the layers of a capture belong to, such as objects, and the coverage by these."""

import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from ..image.detail import merged
from ..image.supersampling import split_pixels

MISSED_PX = 2  # from surfaces: how far they continue into pixels where no sample met one
BACKGROUND = "Background"
MOST_BYTES = 63  # of a pass's name in a file that Blender reads


@dataclass(frozen=True, eq=False)
class Mattes:
    """What the surfaces in a capture belong to.

    Attributes
    ----------
    owners : tuple of str
    shares : tuple of sparse arrays (owner + 1, part)
        For each layer, in the parts of its pixels, row by row: the share of the layer's alpha that the owner's surfaces
        have, and last the background.
    members : mapping of str to collection of str
        The owners that a mask adds up. By default, each owner has a mask.
    """

    owners: tuple[str, ...]
    shares: tuple["scipy.sparse.csr_array", ...]
    members: Mapping[str, Collection[str]] = field(default_factory=dict)

    @classmethod
    def of(cls, layers: Sequence[tuple[np.ndarray, np.ndarray]], owner_of: Mapping[int, str],
           members: Mapping[str, Collection[str]]) -> "Mattes":
        """The mattes of layers.

        Parameters
        ----------
        layers : sequence of (uint32 array, float array)
            For each layer the ids in the parts of its pixels and their shares, by `shares_of_surfaces`.
        owner_of : mapping of int to str
            By id. An unknown id is an owner of its own, as a hexadecimal number.
        members : mapping of str to collection of str
        """
        shown = np.unique(np.concatenate([ids[shares[:-1] > 0] for ids, shares in layers]))
        by_id = [owner_of.get(each, f"{each:08x}") for each in shown.tolist()]
        owners = tuple(sorted(set(by_id)))
        row_of = {owner: row for row, owner in enumerate(owners)}
        rows = np.array([row_of[owner] for owner in by_id], int)
        return cls(owners, tuple(_sparse(rows[np.searchsorted(shown, ids)] if shown.size else ids, shares, len(owners))
                                 for ids, shares in layers), members)

    def masks(self, coverage: np.ndarray) -> list[tuple[str, np.ndarray]]:
        """The background's mask, and those that are not 0 everywhere: names and arrays (row, column). An owner may have
        the background's name.

        `coverage` is an array (owner + 1, row, column); the last is the background.
        """
        members = self.members or {owner: (owner,) for owner in self.owners}
        row_of = {owner: row for row, owner in enumerate(self.owners) if coverage[row].any()}
        rows = {name: [row_of[owner] for owner in owners if owner in row_of] for name, owners in members.items()}
        return [(BACKGROUND, coverage[-1]),
                *((name, coverage[of_mask].sum(axis=0)) for name, of_mask in rows.items() if of_mask)]


def _sparse(rows, shares, count):
    """The sparse array of shares (rank, part) in these rows, and with the background last."""
    rank, part = np.nonzero(shares[:-1])
    background, = np.nonzero(shares[-1])
    row = np.append(rows[rank, part], np.full_like(background, count))
    values = np.append(shares[rank, part], shares[-1, background]).astype(np.float32)
    return scipy.sparse.csr_array((values, (row, np.append(part, background))), (count + 1, shares.shape[1]))


def shares_of_surfaces(ids: np.ndarray, weights: np.ndarray, alpha: np.ndarray, opaque: bool, times: int = 1
                       ) -> tuple[np.ndarray, np.ndarray]:
    """The ids in a layer's pixels, which are divided into parts, and their shares of the layer's alpha.

    In an opaque layer, the background has what surfaces leave. In a transparent one, surfaces have all of the alpha.
    They continue a little into pixels where no sample met one, because the layer's alpha has more samples.

    Parameters
    ----------
    ids : uint32 array (rank, row, column)
        Of Cryptomatte, in the parts of pixels.
    weights : array (rank, row, column)
    alpha : array (row, column)
        Of the surfaces, in the same parts.
    opaque : bool
    times : int
        Parts of a pixel, down and across.

    Returns
    -------
    uint32 array (rank, part), float32 array (rank + 1, part)
        The parts are row by row. The last share is for the background.
    """
    total = weights.sum(axis=0)
    met = total > 0
    shares = np.divide(weights, total, out=np.zeros_like(weights), where=met)
    if opaque:
        shares *= alpha
        background = 1 - shares.sum(axis=0)
    else:
        covered = np.where(met, alpha, 0)
        known = split_pixels(merged(covered[None], times)[0], times)
        of, continued = _nearest(met, known, MISSED_PX * times)
        shares = np.where(known > 0, shares * np.divide(covered, known, out=np.ones_like(known), where=known > 0),
                          shares[:, *of] * continued)
        ids, background = np.where(known > 0, ids, ids[:, *of]), (known == 0) & ~continued
    shares = np.concatenate([shares, background[None]], dtype=np.float32)
    return ids.reshape(len(ids), -1), shares.reshape(len(shares), -1)


def _nearest(met, known, most_px):
    """The nearest parts with surfaces, as their rows and columns, and whether an unknown part is that close to one."""
    if not met.any() or known.all():
        return np.indices(met.shape), np.zeros(met.shape, bool)
    away_px, nearest = scipy.ndimage.distance_transform_edt(~met, return_indices=True)
    return nearest, (known == 0) & (away_px <= most_px)


def names_in_files(names: Sequence[str]) -> list[str]:
    """Names of masks as names of passes in files, all different. Dots, which end the name of a layer, become
    underscores, and long names are shortened."""
    used: list[str] = []
    for name in names:
        stem = name.replace(".", "_").encode()
        ends = itertools.chain([""], (f"_{number:03}" for number in itertools.count(2)))
        offered = (stem[:MOST_BYTES - len(end)].decode(errors="ignore") + end for end in ends)
        used.append(next(each for each in offered if each not in used))
    return used
