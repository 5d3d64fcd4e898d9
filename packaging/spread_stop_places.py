"""Write engine/rays/stop_places.npz: many places of the stop, evenly spread, and none in rows or rings.

    .venv/bin/python packaging/spread_stop_places.py

Each place is the centroid of its cell, and all cells have the same area: a centroidal power diagram (de Goes et al.,
ACM Transactions on Graphics 31(6), 2012), by Lloyd's method from a lattice out of order. The four quarters of the disc
are mirror images of each other, so that the mean of all places is its middle. The file holds one quarter, in
semi-apertures: float32 array (2, count / 4) for each count.
"""

import numpy as np
from scipy.spatial import cKDTree

from lensfield.engine.rays.stop_places import FILE, MANY, QUARTERS, RAY_COUNTS, cell_size, lattice

SAMPLES, MOST_SAMPLES = 512, 600_000  # of a cell, and of all
ROUNDS = 800
DISORDER = 0.5  # standard deviation from the lattice at the start, in cells
GAINS = 0.16, 0.06  # change of a cell's weight for its relative lack of area; in the last fifth of the rounds


def spread(count):
    """Places in one quarter of the stop: array (count / 4, 2)."""
    samples, places = quarter_disc(min(SAMPLES * count, MOST_SAMPLES)), lattice(count).T
    places = places[(places > 0).all(axis=1)]
    places = np.abs(places + np.random.default_rng(0).normal(0, DISORDER * cell_size(count), places.shape))
    places /= np.maximum(np.hypot(*places.T), 1)[:, None]
    weights = np.zeros(len(places))
    for number in range(ROUNDS):
        cells = cells_of(samples, places, weights)
        area = np.bincount(cells, minlength=len(places))
        sums = np.stack([np.bincount(cells, of_axis, len(places)) for of_axis in samples.T], axis=1)
        places = np.where(area[:, None] > 0, sums / np.maximum(area, 1)[:, None], places)
        lack = 1 - area / area.mean()
        weights += GAINS[number >= 0.8 * ROUNDS] / count * lack
        weights -= weights.mean()
    print(f"{count} places: areas differ by {lack.std():.1%}, at most {abs(lack).max():.1%}", flush=True)
    return places * np.sqrt(0.5 / np.square(places).sum(axis=1).mean())


def quarter_disc(count):
    """Evenly spread samples of a quarter of the disc: those of a spiral, folded twice."""
    number = np.arange(count // 4) + 0.5
    azimuth = np.pi * (3 - 5**0.5) * number
    return np.sqrt(number / len(number))[:, None] * np.abs(np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1))


def cells_of(samples, places, weights):
    """The cell of each sample: that of the place with the smallest squared distance, less its weight."""
    lift = np.sqrt(weights.max() - weights)
    lifted = np.concatenate([np.column_stack([places * quarter, lift]) for quarter in QUARTERS])
    return cKDTree(lifted).query(np.column_stack([samples, np.zeros(len(samples))]))[1] % len(places)


if __name__ == "__main__":
    np.savez(FILE, **{str(count): spread(count).T.astype(np.float32) for count in RAY_COUNTS if count >= MANY})
