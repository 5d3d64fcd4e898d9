"""`lensfield camera`: list and inspect cameras."""

import json

import numpy as np

from lensfield.engine.lens.formats import crop_factor
from lensfield.engine.library.bodies import find_cameras, load_camera
from lensfield.engine.sensor.camera import NUMBERS
from lensfield.engine.sensor.exposure import Exposure
from lensfield.engine.sensor.metering import full_scale_e

from .terminal import say

CAMERAS = "a bundled camera (lensfield camera list), or a camera's file (.toml)"


def add_options(command):
    camera = command.add_subparsers(required=True, metavar="COMMAND")
    listing = camera.add_parser("list", help="list the bundled cameras: names, titles, sensors and pixels")
    listing.add_argument("words", nargs="*", metavar="WORD", help="list only cameras that match every word")
    listing.set_defaults(run=_list)
    info = camera.add_parser("info", help="print a camera's sensor: size, pixels, and the parameters of EMVA 1288")
    info.add_argument("camera", metavar="NAME|FILE", help=CAMERAS)
    info.add_argument("--iso", type=float, help="ISO of the gain and the noise (default: the camera's base ISO)")
    info.add_argument("--json", action="store_true", help="print JSON")
    info.set_defaults(run=_info)


def _list(options):
    for name, camera in find_cameras(options.words).items():
        (rows, columns), (across_mm, up_mm) = camera.shape_px, camera.size_mm
        say(f"{name:<22} {camera.title:<46} {across_mm:5.1f} x {up_mm:4.1f} mm  {columns:>5} x {rows:<5}px  "
            f"{camera.pitch_um:.2f} um")


def camera_info(camera, iso=None):
    """Facts about a camera at an ISO, in JSON types."""
    iso = Exposure(1.0, camera.base_iso if iso is None else iso).iso
    rows, columns = camera.shape_px
    peak = camera.quantum_efficiency.argmax(axis=1)
    return {"name": camera.name, "title": camera.title, "maker": camera.maker,
            "pixels": [columns, rows], "sensor_mm": [round(side, 3) for side in camera.size_mm],
            "crop_factor": round(crop_factor(camera.size_mm), 3), "filters": list(camera.filters),
            "channels": camera.channels, "bits": camera.bits, "iso": iso,
            **{name: getattr(camera, name) for name in NUMBERS},
            "gain_at_iso_dn_per_e": camera.gain_at(iso), "dark_noise_at_iso_e": camera.dark_noise_at(iso),
            "saturation_at_iso_e": full_scale_e(camera, iso),
            "quantum_efficiency": {letter: {"peak": float(each[at]), "at_nm": float(camera.wavelengths_nm[at])}
                                   for letter, each, at in zip(camera.channels, camera.quantum_efficiency, peak,
                                                               strict=True)},
            "range_nm": camera.wavelengths_nm[[0, -1]].tolist(),
            "provenance": dict(camera.provenance), "source": camera.source, "notes": camera.notes}


def _info(options):
    info = camera_info(load_camera(options.camera), options.iso)
    say(*(json.dumps(info, indent=2) if options.json else _text(info)).split("\n"))


def _text(info):
    (across_mm, up_mm), (columns, rows), iso = info["sensor_mm"], info["pixels"], info["iso"]
    full_e, noise_e = info["saturation_at_iso_e"], info["dark_noise_at_iso_e"]
    lines = {
        "sensor": f"{across_mm:g} x {up_mm:g} mm, crop factor {info['crop_factor']:.2f}",
        "pixels": f"{columns} x {rows}, {info['pitch_um']:g} um",
        "filters": " / ".join(info["filters"]) or f"none: all pixels have {', '.join(info['channels'])}",
        "quantum efficiency": ", ".join(f"{letter} {peak['peak']:.1%} at {peak['at_nm']:g} nm"
                                        for letter, peak in info["quantum_efficiency"].items()),
        "range": "{:g} to {:g} nm".format(*info["range_nm"]),
        "converter": f"{info['bits']} bits, black level {info['black_dn']:g}",
        "full well": f"{info['saturation_e']:.0f} e",
        "dark current": f"{info['dark_current_e_per_s']:g} e/s",
        "DSNU1288": f"{info['dsnu_e']:g} e",
        "PRNU1288": f"{info['prnu']:.2%}",
        f"at ISO {iso:g}": f"gain K {info['gain_at_iso_dn_per_e']:.4g} DN/e, dark noise {noise_e:.3g} e, saturation "
                           f"{full_e:.0f} e, dynamic range {20 * np.log10(full_e / max(noise_e, 1e-9)):.1f} dB",
        "origin": ", ".join(f"{part} {origin}" for part, origin in info["provenance"].items()),
        "source": info["source"], "notes": info["notes"]}
    return "\n".join([info["title"] or info["name"], *(f"{name:<20}{text}" for name, text in lines.items() if text)])
