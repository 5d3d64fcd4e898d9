"""Write the cameras of the library from measured spectral sensitivities.

    python packaging/make_cameras.py FOLDER

reads data/camera of https://github.com/AcademySoftwareFoundation/rawtoaces-data (Apache-2.0) in FOLDER, and writes
engine/library/cameras. Sizes, pixels, bits and base ISO are the makers'. Sensitivities there are relative to the most
sensitive channel and per joule. Makers do not publish absolute figures; those of a generic sensor take their place:
the most sensitive channel detects half of the photons at its peak, and the full well at the base ISO follows from
ISO 12232's speed from saturation, H = 78 lx s / ISO, under CIE D55.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from lensfield.engine.sensor.camera import Camera
from lensfield.engine.sensor.camera_file import camera_text
from lensfield.engine.sensor.electrons import photons_per_joule, response
from lensfield.engine.spectral.spectra import load_spectrum

OUTPUT = Path(__file__).resolve().parent.parent / "engine/library/cameras"
PEAK_EFFICIENCY = 0.5
SATURATION_LUX_S = 78.0  # times 1 / ISO
BLACK_SHARE = 1 / 32  # of the converter's numbers
GENERIC = {"dark_noise_e": 2.0, "readout_noise_dn": 1.0, "dark_current_e_per_s": 0.1, "dsnu_e": 0.5, "prnu": 0.006}
BAYER, QUAD = ("RG", "GB"), ("RRGG", "RRGG", "GGBB", "GGBB")
X_TRANS = "GBGGRG", "RGRBGB", "GBGGRG", "GRGGBG", "BGBRGR", "GRGGBG"
SOURCE = ("Spectral sensitivity of {camera} measured for rawtoaces-data 1.1.0 (Academy Software Foundation, "
          "Apache-2.0) by {by}. Size, pixels, bits and base ISO as published by the maker.")
ABSOLUTE = ("Absolute figures are not published: a generic sensor's are assumed. The most sensitive channel detects "
            "half of the photons at its peak; the full well follows from ISO 12232 at the base ISO. Noise, dark "
            "current, DSNU and PRNU are typical values. The filter array's first pixel is assumed.")

BODIES = {
    # name: file, title, maker, (columns, rows), width mm, bits, base ISO, filters
    "arri-d21": ("ARRI_D21", "ARRI D-21", "ARRI", (2880, 2160), 23.76, 12, 200, BAYER),
    "canon-eos-400d": ("Canon_Digital_Rebel_XTi", "Canon EOS 400D / Rebel XTi", "Canon", (3888, 2592), 22.2, 12, 100,
                       BAYER),
    "canon-eos-1d-x-ii": ("Canon_EOS-1D_X_Mark_II", "Canon EOS-1D X Mark II", "Canon", (5472, 3648), 35.9, 14, 100,
                          BAYER),
    "canon-eos-1ds-iii": ("Canon_EOS-1Ds_Mark_III", "Canon EOS-1Ds Mark III", "Canon", (5616, 3744), 36.0, 14, 100,
                          BAYER),
    "canon-eos-1ds-ii": ("Canon_EOS-1Ds_Mark_II", "Canon EOS-1Ds Mark II", "Canon", (4992, 3328), 36.0, 12, 100, BAYER),
    "canon-eos-100d": ("Canon_EOS_100D", "Canon EOS 100D", "Canon", (5184, 3456), 22.3, 14, 100, BAYER),
    "canon-eos-200d": ("Canon_EOS_200D", "Canon EOS 200D", "Canon", (6000, 4000), 22.3, 14, 100, BAYER),
    "canon-eos-200d-ii": ("Canon_EOS_200D_II", "Canon EOS 200D II", "Canon", (6000, 4000), 22.3, 14, 100, BAYER),
    "canon-eos-5ds": ("Canon_EOS_5DS", "Canon EOS 5DS", "Canon", (8688, 5792), 36.0, 14, 100, BAYER),
    "canon-eos-5d": ("Canon_EOS_5D", "Canon EOS 5D", "Canon", (4368, 2912), 35.8, 12, 100, BAYER),
    "canon-eos-5d-iii": ("Canon_EOS_5D_Mark_III", "Canon EOS 5D Mark III", "Canon", (5760, 3840), 36.0, 14, 100, BAYER),
    "canon-eos-5d-ii": ("Canon_EOS_5D_Mark_II", "Canon EOS 5D Mark II", "Canon", (5616, 3744), 36.0, 14, 100, BAYER),
    "canon-eos-5d-iv": ("Canon_EOS_5D_Mark_IV", "Canon EOS 5D Mark IV", "Canon", (6720, 4480), 36.0, 14, 100, BAYER),
    "canon-eos-600d": ("Canon_EOS_600D", "Canon EOS 600D", "Canon", (5184, 3456), 22.3, 14, 100, BAYER),
    "canon-eos-m": ("Canon_EOS_M", "Canon EOS M", "Canon", (5184, 3456), 22.3, 14, 100, BAYER),
    "canon-eos-r10": ("Canon_EOS_R10", "Canon EOS R10", "Canon", (6000, 4000), 22.3, 14, 100, BAYER),
    "canon-eos-r5": ("Canon_EOS_R5", "Canon EOS R5", "Canon", (8192, 5464), 36.0, 14, 100, BAYER),
    "canon-eos-r5-ii": ("Canon_EOS_R5m2", "Canon EOS R5 Mark II", "Canon", (8192, 5464), 36.0, 14, 100, BAYER),
    "canon-eos-r6": ("Canon_EOS_R6", "Canon EOS R6", "Canon", (5472, 3648), 35.9, 14, 100, BAYER),
    "canon-eos-r6-ii": ("Canon_EOS_R6m2", "Canon EOS R6 Mark II", "Canon", (6000, 4000), 35.9, 14, 100, BAYER),
    "canon-eos-rp": ("Canon_EOS_RP", "Canon EOS RP", "Canon", (6240, 4160), 35.9, 14, 100, BAYER),
    "canon-eos-r": ("Canon_EOS_R", "Canon EOS R", "Canon", (6720, 4480), 36.0, 14, 100, BAYER),
    "canon-powershot-s90": ("Canon_PowerShot_S90", "Canon PowerShot S90", "Canon", (3648, 2736), 7.44, 12, 80, BAYER),
    "fujifilm-gfx-100": ("Fujifilm_GFX_100", "Fujifilm GFX 100", "Fujifilm", (11648, 8736), 43.8, 14, 100, BAYER),
    "fujifilm-x-t3": ("Fujifilm_X-T3", "Fujifilm X-T3", "Fujifilm", (6240, 4160), 23.5, 14, 160, X_TRANS),
    "fujifilm-x-t4": ("Fujifilm_X-T4", "Fujifilm X-T4", "Fujifilm", (6240, 4160), 23.5, 14, 160, X_TRANS),
    "hasselblad-l1d-20c": ("Hasselblad_L1D-20c", "Hasselblad L1D-20c", "Hasselblad and DJI (Mavic 2 Pro)", (5472, 3648),
                           13.2, 12, 100, BAYER),
    "hasselblad-l2d-20c": ("Hasselblad_L2D-20c", "Hasselblad L2D-20c", "Hasselblad and DJI (Mavic 3)", (5280, 3956),
                           17.3, 12, 100, BAYER),
    "nikon-d200": ("Nikon_D200", "Nikon D200", "Nikon", (3872, 2592), 23.6, 12, 100, BAYER),
    "nikon-d3300": ("Nikon_D3300", "Nikon D3300", "Nikon", (6000, 4000), 23.5, 12, 100, BAYER),
    "nikon-d5100": ("Nikon_D5100", "Nikon D5100", "Nikon", (4928, 3264), 23.6, 14, 100, BAYER),
    "nikon-d5300": ("Nikon_D5300", "Nikon D5300", "Nikon", (6000, 4000), 23.5, 14, 100, BAYER),
    "nikon-d7000": ("Nikon_D7000", "Nikon D7000", "Nikon", (4928, 3264), 23.6, 14, 100, BAYER),
    "nikon-d700": ("Nikon_D700", "Nikon D700", "Nikon", (4256, 2832), 36.0, 14, 200, BAYER),
    "nikon-d70": ("Nikon_D70", "Nikon D70", "Nikon", (3008, 2000), 23.7, 12, 200, BAYER),
    "nikon-d800e": ("Nikon_D800E", "Nikon D800E", "Nikon", (7360, 4912), 35.9, 14, 100, BAYER),
    "nikon-d810": ("Nikon_D810", "Nikon D810", "Nikon", (7360, 4912), 35.9, 14, 64, BAYER),
    "nikon-d850": ("Nikon_D850", "Nikon D850", "Nikon", (8256, 5504), 35.9, 14, 64, BAYER),
    "nikon-zf": ("Nikon_Z_f", "Nikon Z f", "Nikon", (6048, 4032), 35.9, 14, 100, BAYER),
    "panasonic-gx9": ("Panasonic_DC-GX9", "Panasonic Lumix GX9", "Panasonic", (5184, 3888), 17.3, 12, 200, BAYER),
    "sony-rx100-iv": ("Sony_DSC-RX100M4", "Sony RX100 IV", "Sony", (5472, 3648), 13.2, 12, 125, BAYER),
    "sony-a6400": ("Sony_ILCE-6400", "Sony Alpha 6400", "Sony", (6000, 4000), 23.5, 14, 100, BAYER),
    "sony-a7c-ii": ("Sony_ILCE-7CM2", "Sony Alpha 7C II", "Sony", (7008, 4672), 35.9, 14, 100, BAYER),
    "sony-a7-iii": ("Sony_ILCE-7M3", "Sony Alpha 7 III", "Sony", (6000, 4000), 35.6, 14, 100, BAYER),
    "sony-a7-iv": ("Sony_ILCE-7M4", "Sony Alpha 7 IV", "Sony", (7008, 4672), 35.9, 14, 100, BAYER),
    "sony-a7r-ii": ("Sony_ILCE-7RM2", "Sony Alpha 7R II", "Sony", (7952, 5304), 35.9, 14, 100, BAYER),
    "sony-a7r-iii": ("Sony_ILCE-7RM3", "Sony Alpha 7R III", "Sony", (7952, 5304), 35.9, 14, 100, BAYER),
    "sony-a7r-iv": ("Sony_ILCE-7RM4", "Sony Alpha 7R IV", "Sony", (9504, 6336), 35.7, 14, 100, BAYER),
    "sony-a7s-ii": ("Sony_ILCE-7SM2", "Sony Alpha 7S II", "Sony", (4240, 2832), 35.6, 14, 100, BAYER),
    "sony-a7s-iii": ("Sony_ILCE-7SM3", "Sony Alpha 7S III", "Sony", (4240, 2832), 35.6, 14, 80, BAYER),
    "sony-a9": ("Sony_ILCE-9", "Sony Alpha 9", "Sony", (6000, 4000), 35.6, 14, 100, BAYER),
}
"""All of rawtoaces-data 1.1.0 except the Insta360 X5, whose sensor's size is not published."""

LIKE = "the {}'s, measured for rawtoaces-data 1.1.0 (Academy Software Foundation, Apache-2.0)"
SENSORS = {
    # name: sensitivities of, title, (columns, rows), width mm, bits, base ISO, filters, notes
    "generic-phone": ("sony-rx100-iv", "Phone, 1.4 \u00b5m pixels", (4032, 3024), 5.645, 10, 50, BAYER, ""),
    "generic-phone-48": ("sony-rx100-iv", "Phone, Quad Bayer, 0.8 \u00b5m pixels", (8000, 6000), 6.4, 10, 50, QUAD, ""),
    "generic-cinema": ("arri-d21", "Cinema, Super 35 with 8.25 \u00b5m pixels", (3424, 2202), 28.25, 12, 200, BAYER,
                       ""),
    "generic-three-chip": ("sony-rx100-iv", "Three-chip video, 2/3 inch with 5 \u00b5m pixels", (1920, 1080), 9.6, 12,
                           400, (), "A prism lets each channel see all of the light that its filter passes."),
}


def sensitivities(folder, name):
    """(wavelengths_nm, quantum efficiency (channel, wavelength), who measured) of a camera of rawtoaces-data."""
    data = json.loads((folder / f"data/camera/{name}_380_780_5.json").read_text(encoding="utf-8"))
    spectral, header = data["spectral_data"], data["header"]
    assert spectral["units"] == "relative" and spectral["index"]["main"] == ["R", "G", "B"], name
    rows = spectral["data"]["main"]
    nm = np.array([float(key) for key in rows])
    per_photon = np.maximum(np.array(list(rows.values())).T, 0) / photons_per_joule(nm)
    efficiency = np.round(PEAK_EFFICIENCY * per_photon / per_photon.max(), 5)
    return nm, efficiency, header.get("laboratory") or header["document_creator"]


def with_full_well(camera):
    """The camera with the full well that ISO 12232 implies at its base ISO, and a gain that fills the converter."""
    daylight, nm = load_spectrum("illuminant-d55"), np.arange(380.0, 781.0)
    per_lux_s = response(camera, nm) @ daylight.density_at(nm) / daylight.luminous_flux_per_watt()
    full_e = _rounded(per_lux_s.max() * SATURATION_LUX_S / camera.base_iso, 3)
    return replace(camera, saturation_e=full_e, gain_dn_per_e=_rounded((camera.white_dn - camera.black_dn) / full_e, 4))


def _rounded(value, digits):
    return float(f"{value:.{digits}g}")


def generic(name, title, maker, pixels, width_mm, bits, base_iso, filters, sensitivity, **texts):
    """A camera with these sensitivities and otherwise generic figures."""
    nm, efficiency = sensitivity
    columns, rows = pixels
    return with_full_well(Camera(
        name, (rows, columns), _rounded(1e3 * width_mm / columns, 4), filters, "RGB", nm, efficiency, 1.0,
        float(base_iso), 1.0, bits, black_dn=float(round(2**bits * BLACK_SHARE)), title=title, maker=maker,
        **GENERIC, **texts))


def cameras(folder):
    """All cameras of the library."""
    measured = {}
    for name, (file, title, maker, *figures) in BODIES.items():
        nm, efficiency, by = sensitivities(folder, file)
        measured[name] = nm, efficiency
        yield generic(name, title, maker, *figures, measured[name], notes=ABSOLUTE,
                      source=SOURCE.format(camera=f"a {title}" if title[0] not in "AEIOU" else f"an {title}", by=by),
                      provenance=(("size", "published"), ("sensitivity", "measured"), ("noise", "generic")))
    for name, (like, title, *figures, notes) in SENSORS.items():
        yield generic(name, title, "", *figures, measured[like], notes=f"{ABSOLUTE} {notes}".strip(),
                      source=f"Not a product: typical figures. Spectral sensitivity is {LIKE.format(BODIES[like][1])}.",
                      provenance=(("size", "generic"), ("sensitivity", "measured"), ("noise", "generic")))


def main(folder):
    OUTPUT.mkdir(exist_ok=True)
    for camera in cameras(Path(folder)):
        (OUTPUT / f"{camera.name}.toml").write_text(camera_text(camera), encoding="utf-8")
        print(f"{camera.name:<22} {camera.pitch_um:5.2f} um, full well {camera.saturation_e:6.0f} e, "
              f"K {camera.gain_dn_per_e:.3f} DN/e")


if __name__ == "__main__":
    main(sys.argv[1])
