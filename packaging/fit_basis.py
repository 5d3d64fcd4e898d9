"""The reflectance of each linear Rec. 709 primary, fitted to measured reflectances.

Three curves convert a colour to a reflectance: R(nm) = basis(nm) @ rgb. The curves are subject to two conditions:
  * they are between 0 and 1 and sum to 1 (white reflects everything, and mixtures never reflect more),
  * they reproduce every colour under D65 (CIE 1931 observer).
Under these, they are the least-squares fit to the samples, with a small weight on smoothness.
"""

import colour
import numpy as np
from scipy.optimize import lsq_linear

SHAPE = colour.SpectralShape(380, 780, 5)
NM = SHAPE.wavelengths
OBSERVER = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"][NM]
D65 = colour.SDS_ILLUMINANTS["D65"][NM]
PRIMARIES = np.array([[0.64, 0.33, 0.03], [0.30, 0.60, 0.10], [0.15, 0.06, 0.79]])  # x, y, z of R, G, B
SMOOTHNESS = 0.01
STRICTNESS = 1e3  # weight of the exact conditions, relative to the samples


def measured_reflectances():
    """The 99 samples of the CIE 2017 colour fidelity index and the 24 patches of ISO 17321-1: two arrays (n, nm)."""
    fidelity = colour.quality.cfi2017.load_TCS_CIE2017(SHAPE)
    chart = colour.SDS_COLOURCHECKERS["ISO 17321-1"].values()
    return np.asarray(fidelity.values).T, np.stack([patch[NM] for patch in chart])


def to_rec709():
    """Matrix (nm, 3) from a reflectance to its linear Rec. 709 colour under D65; white is (1, 1, 1)."""
    tristimulus = D65[:, None] * OBSERVER / (D65 @ OBSERVER[:, 1])
    primaries = PRIMARIES.T / PRIMARIES[:, 1]
    primaries = primaries * np.linalg.solve(primaries, tristimulus.sum(axis=0))
    return tristimulus @ np.linalg.inv(primaries).T


def fit_basis(samples):
    """Reflectances of red, green and blue.

    Parameters
    ----------
    samples : array (n, nm)

    Returns
    -------
    array (nm, 3), to six digits
    """
    colours = samples @ to_rec709()
    curvature = np.diff(np.eye(NM.size), 2, axis=0)
    objective = (np.kron(np.eye(NM.size), colours.T @ colours / len(samples))
                 + SMOOTHNESS * np.kron(curvature.T @ curvature, np.eye(3)))
    factor = np.linalg.cholesky(objective)
    towards = np.linalg.solve(factor, (samples.T @ colours).ravel() / len(samples))
    sums = np.kron(np.eye(NM.size), np.ones((1, 3)))
    back = np.stack([np.kron(weights, unit) for weights in to_rec709().T for unit in np.eye(3)])
    rows = np.vstack([factor.T, STRICTNESS * sums, 10 * STRICTNESS * back])
    wanted = np.concatenate([towards, STRICTNESS * np.ones(NM.size), 10 * STRICTNESS * np.eye(3).ravel()])
    orthogonal, triangle = np.linalg.qr(rows)
    fitted = lsq_linear(triangle, orthogonal.T @ wanted, bounds=(0, 1), method="bvls", max_iter=3000, tol=1e-14)
    red, green, _ = fitted.x.reshape(-1, 3).T.round(6)
    return np.stack([red, green, (1 - red - green).round(6)], axis=-1)
