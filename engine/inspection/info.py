"""The figures of a lens, for the command line and for reports."""

import numpy as np

from ..lens.radial_lens import RadialLens
from ..runtime.values import json_value
from .curves import lateral_colour_um, reference_nm, relative_illumination

FRAUNHOFER_F_NM, FRAUNHOFER_C_NM = 486.1, 656.3


def lens_info(lens: RadialLens) -> dict:
    """First-order data, and distortion, relative illumination and lateral colour over the field.

    Returns
    -------
    dict of numbers, lists and strings, ready for JSON. `heights` contains, for each field height at the reference
    wavelength: height_mm (paraxial), real_height_mm, distortion_percent, relative_illumination (of pictures, with the
    light that PSFs move), lateral_colour_um
    (real height at F minus real height at C, with both wavelengths clipped to the lens data). An infinite object
    distance and an unknown enclosed energy are None.
    """
    short, long = lens.nearest_nm([FRAUNHOFER_F_NM, FRAUNHOFER_C_NM])
    short_um, long_um = lateral_colour_um(lens, [short, long])
    nm = reference_nm(lens)
    reference = lens.at_wavelength(nm)
    off_axis = np.where(lens.heights_mm > 0, lens.heights_mm, 1)
    distortion_percent = 100 * (reference.real_height_mm - lens.heights_mm) / off_axis
    return {
        "name": lens.name, "maker": lens.maker, "story": lens.story, "source": lens.source, "notes": lens.notes,
        "efl_mm": lens.efl_mm, "magnification": lens.magnification, "f_number_effective": lens.f_number_effective,
        "object_distance_mm": json_value(lens.object_distance_mm), "entrance_pupil_mm": lens.entrance_pupil_mm,
        "capture_focal_length_mm": lens.capture_focal_length_mm, "sensor_mm": list(lens.sensor_mm),
        "reference_wavelength_nm": lens.reference_wavelength_nm,
        "wavelengths_nm": lens.wavelengths_nm.tolist(), "heights_mm": lens.heights_mm.tolist(),
        "psf_samples": list(lens.psf.shape[2:]), "psf_pitch_um": lens.psf_pitch_um,
        "least_enclosed_energy": json_value(lens.enclosed_energy.min()),
        "lateral_colour_between_nm": [float(short), float(long)],
        "heights": [
            {"height_mm": float(height), "real_height_mm": float(real), "distortion_percent": float(distortion),
             "relative_illumination": float(illumination), "lateral_colour_um": float(lateral)}
            for height, real, distortion, illumination, lateral in zip(
                lens.heights_mm, reference.real_height_mm, distortion_percent, *relative_illumination(lens, nm),
                short_um - long_um, strict=True)],
    }


def lens_text(info: dict) -> str:
    """The figures of `lens_info` as text."""
    short, long = info["lateral_colour_between_nm"]
    distance, enclosed = info["object_distance_mm"], info["least_enclosed_energy"]
    lines = [
        *(info[fact] for fact in ("name", "maker", "story", "source") if info[fact]), "",
        f"focal length             {info['efl_mm']:.5f} mm",
        f"magnification            {info['magnification']:.6f}",
        f"effective f-number       {info['f_number_effective']:.3f}",
        f"object distance          {'infinity' if distance is None else f'{distance:g} mm'}",
        f"sensor                   {info['sensor_mm'][0]:g} x {info['sensor_mm'][1]:g} mm",
        f"wavelengths              {info['wavelengths_nm'][0]:g} to {info['wavelengths_nm'][-1]:g} nm"
        f" ({len(info['wavelengths_nm'])}), reference {info['reference_wavelength_nm']:g} nm",
        f"point spread functions   {info['psf_samples'][0]} x {info['psf_samples'][1]} samples of"
        f" {info['psf_pitch_um']:g} um, containing "
        + ("an unknown part of the light" if enclosed is None else f"at least {enclosed:.1%} of the light"), "",
        "field height  real height  distortion  relative      lateral colour",
        f"(paraxial)                             illumination  {short:g} - {long:g} nm",
    ]
    lines += [f"{row['height_mm']:9.3f} mm {row['real_height_mm']:9.4f} mm {row['distortion_percent']:9.2f} %"
              f" {row['relative_illumination']:12.4f} {row['lateral_colour_um']:12.2f} um" for row in info["heights"]]
    if info["notes"]:
        lines += ["", info["notes"]]
    return "\n".join(lines)


def table_summary(lens: RadialLens) -> str:
    """The size of a lens's tables, and the least light that a PSF of them holds, in one line."""
    wavelength, height = divmod(int(lens.enclosed_energy.argmin()), lens.heights_mm.size)
    return (f"f = {lens.efl_mm:.5g} mm, f/{lens.f_number_effective:.3g}, {lens.heights_mm.size} heights to "
            f"{lens.heights_mm[-1]:.4g} mm x {lens.wavelengths_nm.size} wavelengths; PSFs of {lens.psf.shape[-1]} x "
            f"{lens.psf.shape[-1]} samples of {lens.psf_pitch_um:g} um contain at least "
            f"{lens.enclosed_energy.min():.2%} of the light (minimum at {lens.heights_mm[height]:.4g} mm, "
            f"{lens.wavelengths_nm[wavelength]:g} nm)")
