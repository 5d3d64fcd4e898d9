"""Light on the sensor by plain counting of rays: no aiming, no pupil, and nothing of the lens data.

Rays start at random places of the stop, in random directions. Those that pass all surfaces, and come from in front of
the lens, carry their etendue from a scene of uniform radiance to where they land.
"""

import numpy as np
from scipy.stats import qmc

from lensfield.engine.prescription.system import System
from lensfield.engine.rays.trace import trace_both_ways

STEEPEST = 4.0  # slope at the stop
SEARCHES, FEW = 3, 14  # narrowing the slopes; logarithm of their rays
MARGIN = 0.02  # of the range of slopes


def counted_light(system: System, edges_mm: np.ndarray, nm: float, rays: int = 18, repeats: int = 4
                  ) -> tuple[np.ndarray, np.ndarray]:
    """Irradiance over radiance on rings of the sensor, and its standard error: arrays (ring,), in sr.

    `rays` is the logarithm of their number in each of the repeats. The stop must be flat and in air.
    """
    low, high = np.array([0.0, -STEEPEST]), np.array([STEEPEST, STEEPEST])
    for _ in range(SEARCHES):
        _, light, slope = _traced(system, nm, low, high, FEW, 0)
        passing, margin = slope[:, light > 0], MARGIN * (high - low)
        low, high = np.maximum(passing.min(axis=1) - margin, [0.0, -STEEPEST]), passing.max(axis=1) + margin
    counts = []
    for seed in range(repeats):
        radius_mm, light, _ = _traced(system, nm, low, high, rays, seed)
        counts.append(np.histogram(radius_mm, edges_mm, weights=light)[0] / (np.pi * np.diff(edges_mm**2)))
    return np.mean(counts, axis=0), np.std(counts, axis=0, ddof=1) / np.sqrt(repeats)


def _traced(system, nm, low, high, rays, seed):
    """Radii on the sensor, etendues in mm^2 sr, 0 for blocked rays, and slopes (2, ray) at the stop."""
    stop_mm = system.stop_semi_aperture_mm
    place, *slope = qmc.Sobol(3, seed=seed).random_base2(rays).T
    height_mm, slope = stop_mm * np.sqrt(place), low[:, None] + np.array(slope) * (high - low)[:, None]
    indices = system.indices_at([nm])[:, :, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        traced = trace_both_ways(system.prescription, indices, 0 * height_mm[None], height_mm[None], *slope[:, None])
    squares_mm2 = system.semi_apertures_mm[:, None]**2
    passing = (np.isfinite(traced.path_mm[0]) & (traced.before[2, 0] > 0)
               & np.all(traced.square_mm2[:, 0] <= squares_mm2, axis=0))
    per_ray = 2 * np.pi * stop_mm**2 * np.prod(high - low) / height_mm.size  # both halves of the stop
    return (np.hypot(*traced.position[:2, 0]), np.where(passing, per_ray / (1 + np.sum(slope**2, axis=0))**2, 0.0),
            slope)
