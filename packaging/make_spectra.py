"""Write the tables from colour-science: engine/spectral/data/*.csv, and most of the spectra in that folder.

    pip install -e .[tables]
    python packaging/make_spectra.py

Requires a separate environment: colour-science needs numpy 2, which Blender up to 5.0 does not support. The
reflectances of the USGS Spectral Library and the refractive indices of refractiveindex.info are not written here: they
are the original files, whose headers name the source.
"""

from pathlib import Path

import colour
import numpy as np

from fit_basis import NM, fit_basis, measured_reflectances

DATA = Path(__file__).resolve().parent.parent / "engine" / "spectral" / "data"
CIE = "relative power, CIE 015:2018"
NIST = "relative power, NIST CQS data (Davis and Ohno)"

ILLUMINANTS = {
    "illuminant-a": ("A", "CIE standard illuminant A (tungsten, 2856 K)"),
    "illuminant-d50": ("D50", "CIE illuminant D50 (daylight, 5003 K)"),
    "illuminant-d55": ("D55", "CIE illuminant D55 (daylight, 5503 K)"),
    "illuminant-d65": ("D65", "CIE standard illuminant D65 (daylight, 6504 K)"),
    "illuminant-d75": ("D75", "CIE illuminant D75 (north sky, 7504 K)"),
    "illuminant-e": ("E", "Equal-energy illuminant E"),
    "fluorescent-fl1": ("FL1", "CIE illuminant FL1 (daylight fluorescent, 6430 K)"),
    "fluorescent-fl2": ("FL2", "CIE illuminant FL2 (cool white fluorescent)"),
    "fluorescent-fl3": ("FL3", "CIE illuminant FL3 (white fluorescent, 3450 K)"),
    "fluorescent-fl4": ("FL4", "CIE illuminant FL4 (warm white fluorescent, 2940 K)"),
    "fluorescent-fl5": ("FL5", "CIE illuminant FL5 (daylight fluorescent, 6350 K)"),
    "fluorescent-fl6": ("FL6", "CIE illuminant FL6 (light white fluorescent, 4150 K)"),
    "fluorescent-fl7": ("FL7", "CIE illuminant FL7 (broad-band fluorescent, 6500 K)"),
    "fluorescent-fl8": ("FL8", "CIE illuminant FL8 (broad-band fluorescent, 5000 K)"),
    "fluorescent-fl9": ("FL9", "CIE illuminant FL9 (broad-band fluorescent, 4150 K)"),
    "fluorescent-fl10": ("FL10", "CIE illuminant FL10 (three-band fluorescent, 5000 K)"),
    "fluorescent-fl11": ("FL11", "CIE illuminant FL11 (three-band fluorescent, 4000 K)"),
    "fluorescent-fl12": ("FL12", "CIE illuminant FL12 (three-band fluorescent, 3000 K)"),
    "led-b1": ("LED-B1", "CIE illuminant LED-B1 (phosphor-converted blue LED, 2733 K)"),
    "led-b2": ("LED-B2", "CIE illuminant LED-B2 (phosphor-converted blue LED, 2998 K)"),
    "led-b3": ("LED-B3", "CIE illuminant LED-B3 (phosphor-converted blue LED, 4103 K)"),
    "led-b4": ("LED-B4", "CIE illuminant LED-B4 (phosphor-converted blue LED, 5109 K)"),
    "led-b5": ("LED-B5", "CIE illuminant LED-B5 (phosphor-converted blue LED, 6598 K)"),
    "led-bh1": ("LED-BH1", "CIE illuminant LED-BH1 (phosphor-converted blue LED and red LED, 2851 K)"),
    "led-rgb1": ("LED-RGB1", "CIE illuminant LED-RGB1 (mixed red, green and blue LEDs)"),
    "led-v1": ("LED-V1", "CIE illuminant LED-V1 (phosphor-converted violet LED, 2724 K)"),
    "led-v2": ("LED-V2", "CIE illuminant LED-V2 (phosphor-converted violet LED, 4070 K)"),
    "sodium-hp1": ("HP1", "CIE illuminant HP1 (standard high-pressure sodium lamp)"),
    "sodium-hp2": ("HP2", "CIE illuminant HP2 (colour-enhanced high-pressure sodium lamp)"),
    "metal-halide-hp3": ("HP3", "CIE illuminant HP3 (high-pressure metal halide lamp)"),
    "metal-halide-hp4": ("HP4", "CIE illuminant HP4 (high-pressure metal halide lamp)"),
    "metal-halide-hp5": ("HP5", "CIE illuminant HP5 (high-pressure metal halide lamp)"),
}
LAMPS = {
    "mercury": ("Mercury", "High-pressure mercury lamp"),
    "mercury-deluxe": ("H38JA-100/DX (Mercury DX)", "High-pressure mercury lamp with phosphor"),
    "sodium-lp": ("LPS", "Low-pressure sodium lamp"),
}
CHART = ("dark-skin", "light-skin", "blue-sky", "foliage", "blue-flower", "bluish-green", "orange", "purplish-blue",
         "moderate-red", "purple", "yellow-green", "orange-yellow", "blue", "green", "red", "yellow", "magenta", "cyan",
         "white", "neutral-8", "neutral-6-5", "neutral-5", "neutral-3-5", "black")


def write_spectrum(kind, name, head, spectrum):
    rows = "".join(f"{wavelength:g} {value:g}\n" for wavelength, value in zip(NM, spectrum[NM], strict=True))
    (DATA / "spectra" / kind / f"{name}.spd").write_text(f"# {head}\n# wavelength_nm value\n{rows}")


def write_table(name, head, columns, nm, values, digits):
    rows = "".join(f"{wavelength:g},{','.join(f'{value:.{digits}g}' for value in row)}\n"
                   for wavelength, row in zip(nm, values, strict=True))
    (DATA / name).write_text(f"# {head}\nwavelength_nm,{columns}\n{rows}")


def write_lights():
    for name, (key, what) in ILLUMINANTS.items():
        write_spectrum("lights", name, f"{what}, {CIE}", colour.SDS_ILLUMINANTS[key])
    for name, (key, what) in LAMPS.items():
        write_spectrum("lights", name, f"{what}, {NIST}", colour.SDS_LIGHT_SOURCES[key])


def write_chart():
    patches = colour.SDS_COLOURCHECKERS["ISO 17321-1"].items()
    for number, (name, (patch, spectrum)) in enumerate(zip(CHART, patches, strict=True), 1):
        write_spectrum("reflectances", f"chart-{number:02}-{name}",
                       f"24-patch colour chart, patch {number}, {patch}: spectral reflectance, ISO 17321-1", spectrum)


def write_observer():
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    nm = np.arange(360, 831, 5)
    write_table("cie1931_2deg.csv", "CIE 1931 2-degree standard observer, CIE 015:2018, every 5 nm", "xbar,ybar,zbar",
                nm, observer[nm].round(12), 8)


def write_basis():
    basis = fit_basis(np.vstack(measured_reflectances()))
    head = ("Reflectance of each linear Rec. 709 primary, fitted to the CIE 2017 fidelity samples and the ISO 17321-1 "
            "chart by packaging/fit_basis.py")
    write_table("reflectance_basis.csv", head, "red,green,blue", NM, basis, 6)


def main():
    write_lights()
    write_chart()
    write_observer()
    write_basis()


if __name__ == "__main__":
    main()
