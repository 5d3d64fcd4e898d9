"""Ways to upsample colours: bases of reflectances for linear Rec. 709, tested on measured reflectances."""

import sys
from collections.abc import Iterator

import colour
import numpy as np
from cases import ROOT
from colour.utilities import suppress_warnings

from lensfield.engine.image.spectral_image import SpectralImage
from lensfield.engine.pictures.preview import to_rec709 as picture
from lensfield.engine.spectral.spectra import library_names, load_spectrum, reflectance_basis, white_density

sys.path.append(str(ROOT / "packaging"))
from fit_basis import D65, NM, OBSERVER, fit_basis, measured_reflectances, to_rec709  # noqa: E402

LAMPS = ("A", "FL11", "LED-B3", "D50")
FEW = (6, 9, 12)


def upsampling() -> Iterator[str]:
    """Compare ways to upsample colours: bases of reflectances for linear Rec. 709, tested on measured reflectances.

    Each sample's colour under D65 is upsampled to a reflectance. The tables give the root mean square of its error, and
    the colour difference CIEDE2000 from the sample under other lamps: median and 95th percentile. Samples outside the
    gamut are omitted. The project's basis is fitted to the first two sets. "held out" is fitted to the other of these
    sets each time, so it is never tested on the samples that it was fitted to.
    """
    fidelity, chart = measured_reflectances()
    names = (name for name in library_names("reflectance") if not name.startswith("chart-"))
    natural = np.stack([load_spectrum(name).at(NM) for name in names])
    with suppress_warnings(colour_usage_warnings=True, python_warnings=True):
        yield from table("99 CIE 2017 samples", fidelity, chart)
        yield from table("24 chart patches", chart, fidelity)
        yield from table("library's USGS samples", natural, np.vstack([fidelity, chart]))
        yield from few_wavelengths(np.vstack([fidelity, chart]))


def tristimulus(reflectances, lamp):
    return reflectances * lamp @ OBSERVER / (lamp @ OBSERVER[:, 1])


def lab(xyz, white):
    return colour.XYZ_to_Lab(xyz, colour.XYZ_to_xy(white)) if white[1] == 1 else lab(xyz / white[1], white / white[1])


def differences(first, second, lamp):
    """CIEDE2000 between reflectances under a lamp."""
    white = tristimulus(np.ones_like(NM), lamp)
    return colour.delta_E(*(lab(tristimulus(some, lamp), white) for some in (first, second)), method="CIE 2000")


def upsampled(samples, others):
    """Reflectances upsampled from the colours of the samples, by the name of the basis."""
    rgb = samples @ to_rec709()
    mallett_yuksel = colour.recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019[NM]
    linear = {"held out": fit_basis(others), "project": reflectance_basis(NM), "Mallett-Yuksel 2019": mallett_yuksel}
    return {name: rgb @ basis.T for name, basis in linear.items()}


def table(title, samples, others):
    rgb = samples @ to_rec709()
    samples = samples[(rgb.min(axis=1) >= 0) & (rgb.max(axis=1) <= 1)]
    yield f"\n| {title}, {len(samples)} in gamut | RMS | {' | '.join(LAMPS)} |\n|---|---|{'---|' * len(LAMPS)}"
    for name, spectra in upsampled(samples, others).items():
        under = (differences(samples, spectra, colour.SDS_ILLUMINANTS[lamp][NM]) for lamp in LAMPS)
        cells = (f"{np.median(delta_e):.2f} / {np.percentile(delta_e, 95):.2f}" for delta_e in under)
        yield f"| {name} | {np.sqrt(np.mean((spectra - samples)**2)):.3f} | {' | '.join(cells)} |"


def few_wavelengths(samples):
    """Colour differences under D65 of renders at few wavelengths between 400 and 700 nm."""
    rgb = samples @ to_rec709()
    rgb = rgb[(rgb.min(axis=1) >= 0) & (rgb.max(axis=1) <= 1)]
    primaries = tristimulus(np.eye(NM.size), D65).T @ np.linalg.pinv(to_rec709()).T
    white = primaries.sum(axis=1)
    yield f"\n| wavelengths rendered | {' | '.join(map(str, FEW))} |\n|---|{'---|' * len(FEW)}"
    bases = {"project": reflectance_basis(NM),
             "Mallett-Yuksel 2019": colour.recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019[NM]}
    for name, basis in bases.items():
        cells = []
        for count in FEW:
            nm = np.linspace(400, 700, count)
            curves = np.stack([np.interp(nm, NM, curve) for curve in basis.T], axis=-1) * white_density(nm)[:, None]
            image = picture(SpectralImage((curves @ rgb.T)[:, None], nm, pitch_um=1))[0].astype(float)
            delta_e = colour.delta_E(lab(image @ primaries.T, white), lab(rgb @ primaries.T, white), method="CIE 2000")
            cells.append(f"{np.median(delta_e):.2f} / {np.percentile(delta_e, 95):.2f}")
        yield f"| {name} | {' | '.join(cells)} |"
