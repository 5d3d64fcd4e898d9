"""Which spectra to give to colours: ways of making a reflectance from linear Rec. 709, on reflectances measured.

    pip install -e .[tables]
    python benchmarks/upsampling.py

Each sample's colour under D65 is made into a reflectance again. Printed are the root mean square of what that misses,
and the colour difference CIEDE2000 from the sample under other lamps: median and 95 %. Samples outside the gamut are
left out. The basis of the project is fitted to the first two sets; so that it is judged by what it has not seen, "held
out" is fitted to the other one each time. Only linear ways (held out, project, Mallett-Yuksel) can be wired into node
trees.
"""

import sys
from pathlib import Path

import colour
import numpy as np
from colour.recovery import RGB_to_sd_Smits1999, XYZ_to_sd_Jakob2019, XYZ_to_sd_Otsu2018
from colour.utilities import suppress_warnings

from lensfield.engine.image.preview import to_rec709 as picture
from lensfield.engine.image.spectral_image import SpectralImage
from lensfield.engine.spectral.spectra import library_names, load_spectrum, reflectance_basis, white_density

sys.path.append(str(Path(__file__).resolve().parents[1] / "packaging"))
from fit_basis import D65, NM, OBSERVER, SHAPE, fit_basis, measured_reflectances, to_rec709  # noqa: E402

LAMPS = ("A", "FL11", "LED-B3", "D50")
FEW = (6, 9, 12)


def tristimulus(reflectances, lamp):
    return reflectances * lamp @ OBSERVER / (lamp @ OBSERVER[:, 1])


def lab(xyz, white):
    return colour.XYZ_to_Lab(xyz, colour.XYZ_to_xy(white)) if white[1] == 1 else lab(xyz / white[1], white / white[1])


def differences(first, second, lamp):
    """CIEDE2000 of reflectances seen under a lamp."""
    white = tristimulus(np.ones_like(NM), lamp)
    return colour.delta_E(*(lab(tristimulus(some, lamp), white) for some in (first, second)), method="CIE 2000")


def nonlinear(rgb):
    """Reflectances by the ways that are no three curves, for comparison."""
    observer, lamp = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(SHAPE), \
        colour.SDS_ILLUMINANTS["D65"].copy().align(SHAPE)
    xyz = tristimulus(np.eye(NM.size), D65).T @ np.linalg.pinv(to_rec709()).T @ rgb
    found = {"Smits 1999": RGB_to_sd_Smits1999(rgb), "Jakob-Hanika 2019": XYZ_to_sd_Jakob2019(xyz, observer, lamp),
             "Otsu 2018": XYZ_to_sd_Otsu2018(xyz, observer, lamp)}
    return {name: np.interp(NM, spectrum.wavelengths, spectrum.values) for name, spectrum in found.items()}


def upsampled(samples, others):
    """Reflectances made from the colours of the samples, by the name of the way."""
    rgb = samples @ to_rec709()
    mallett_yuksel = colour.recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019[NM]
    linear = {"held out": fit_basis(others), "project": reflectance_basis(NM), "Mallett-Yuksel 2019": mallett_yuksel}
    ways = {name: rgb @ basis.T for name, basis in linear.items()}
    each = [nonlinear(one) for one in rgb]
    return ways | {name: np.stack([found[name] for found in each]) for name in each[0]}


def print_table(title, samples, others):
    rgb = samples @ to_rec709()
    samples = samples[(rgb.min(axis=1) >= 0) & (rgb.max(axis=1) <= 1)]
    print(f"\n| {title}, {len(samples)} in gamut | RMS | {' | '.join(LAMPS)} |\n|---|---|{'---|' * len(LAMPS)}")
    for name, made in upsampled(samples, others).items():
        under = (differences(samples, made, colour.SDS_ILLUMINANTS[lamp][NM]) for lamp in LAMPS)
        cells = (f"{np.median(found):.2f} / {np.percentile(found, 95):.2f}" for found in under)
        print(f"| {name} | {np.sqrt(np.mean((made - samples)**2)):.3f} | {' | '.join(cells)} |")


def print_few_wavelengths(samples):
    """What a render at few wavelengths, 400 to 700 nm, makes of the colours under D65."""
    rgb = samples @ to_rec709()
    rgb = rgb[(rgb.min(axis=1) >= 0) & (rgb.max(axis=1) <= 1)]
    primaries = tristimulus(np.eye(NM.size), D65).T @ np.linalg.pinv(to_rec709()).T
    white = primaries.sum(axis=1)
    print(f"\n| wavelengths rendered | {' | '.join(map(str, FEW))} |\n|---|{'---|' * len(FEW)}")
    bases = {"project": reflectance_basis(NM),
             "Mallett-Yuksel 2019": colour.recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019[NM]}
    for name, basis in bases.items():
        cells = []
        for count in FEW:
            nm = np.linspace(400, 700, count)
            curves = np.stack([np.interp(nm, NM, curve) for curve in basis.T], axis=-1) * white_density(nm)[:, None]
            seen = picture(SpectralImage((curves @ rgb.T)[:, None], nm, pitch_um=1))[0].astype(float)
            found = colour.delta_E(lab(seen @ primaries.T, white), lab(rgb @ primaries.T, white), method="CIE 2000")
            cells.append(f"{np.median(found):.2f} / {np.percentile(found, 95):.2f}")
        print(f"| {name} | {' | '.join(cells)} |")


def main():
    fidelity, chart = measured_reflectances()
    names = (name for name in library_names("reflectance") if not name.startswith("chart-"))
    natural = np.stack([load_spectrum(name).at(NM) for name in names])
    with suppress_warnings(colour_usage_warnings=True, python_warnings=True):
        print_table("99 CIE 2017 samples", fidelity, chart)
        print_table("24 chart patches", chart, fidelity)
        print_table("library's USGS samples", natural, np.vstack([fidelity, chart]))
        print_few_wavelengths(np.vstack([fidelity, chart]))


if __name__ == "__main__":
    main()
