"""Lenses and sensors: figures of anamorphic lenses, and the processor seconds of bakes, racks, grids and exposures."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from cases import HD, night_street, on_grid
from timing import cold_run, least_s, machine, marked, without_cache

from lensfield.engine import Options, SpectralImage
from lensfield.engine.bake.bake import bake as baked
from lensfield.engine.library import bundled_lenses, load_lens, prescription_of
from lensfield.engine.library.baked import WAVELENGTHS_NM
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.ray_table import ray_table
from lensfield.engine.rays.rings import NEAREST_MM, Rings, in_metres, ring_ends, turned
from lensfield.engine.sensor.camera import Camera
from lensfield.engine.sensor.electrons import response
from lensfield.engine.sensor.exposure import Exposure, expose

RACKED = ("zeiss-s-biogon-40mm", "tessar-50mm", "apple-phone-4mm", "canon-50mm-f0.95", "nikkor-58mm-f1.4",
          "arri-signature-prime-58mm", "nikkor-z-35mm-f1.2", "angenieux-50mm")
FRAMES, PICTURES_NM = 24, (np.linspace(400, 700, 21), np.linspace(400, 700, 9), np.linspace(450, 650, 3))

WAVELENGTHS, ACCURACY, BEST_OF, MOST = 12, 0.01, 2, 2.0
KINDS = {"four quadrants alike": (True, True), "two halves alike": (False, True), "nothing alike": (False, False)}

SHAPE_PX, PITCH_UM, NM = (3000, 4000), 3.0, np.linspace(400, 700, 12)
EFFICIENCY = 0.5 * np.exp(-(np.subtract.outer([600.0, 530.0, 460.0], NM) / 50)**2)
BAYER = Camera("bench", SHAPE_PX, PITCH_UM, ("RG", "GB"), "RGB", NM, EFFICIENCY, gain_dn_per_e=0.35, base_iso=100.0,
               saturation_e=10000.0, bits=12, black_dn=64.0, dark_noise_e=2.5, readout_noise_dn=0.5, dsnu_e=1.0,
               prnu=0.006)
SENSORS = {"Bayer": BAYER, "three chips": replace(BAYER, filters=())}
LIGHTS = {"without noise": (1000, PITCH_UM, False), "5 e": (5, PITCH_UM, True), "50 e": (50, PITCH_UM, True),
          "1000 e": (1000, PITCH_UM, True), "1000 e, from pixels of 6 um": (1000, 6.0, True)}
"""Mean electrons in green pixels, the picture's pitch, and whether there is noise."""
SHUTTER_S = 0.01


def anamorphic() -> Iterator[str]:
    """The anamorphic lenses of the library: focal lengths and squeeze, far and near.

    For each lens, the focal lengths of the picture's width and height, at infinity; its squeeze at the farthest and at
    the closest focus, which is the ratio of the magnifications of height and width; and how far apart the paraxial foci
    of the two sections are there. All figures are to first order.
    """
    yield f"{'lens':<28}{'width x height':>20}{'squeeze':>9}{'near':>9}{'at':>9}{'apart':>11}{'near':>11}"
    for prescription in bundled_lenses().values():
        if not prescription.radial:
            yield anamorphic_line(prescription)


def anamorphic_line(prescription):
    """A lens's line of the table."""
    ends = [turned(prescription, Rings(focus_mm)) for focus_mm in (float("inf"), NEAREST_MM)]
    far, near = (system_of(end.prescription) for end in ends)
    squeezes = "".join(f"{system.squeeze:9.3f}" for system in (far, near))
    apart_um = "".join(f"{1e3 * (system.across.image_distance_mm - system.image_distance_mm):8.0f} um"
                       for system in (far, near))
    return (f"{prescription.name:<28}{far.across.efl_mm:8.2f} x {far.efl_mm:6.2f} mm{squeezes}"
            f"{in_metres(ends[1].focus_mm):>9}{apart_um}")


def bake(lenses=(), *, quality: str = "preview") -> Iterator[str]:
    """Processor seconds of baking lenses and of tracing their tables of rays: a line for each lens.

    The rings are at rest. By default, all rotationally symmetric lenses of the library are baked. Nothing is cached.
    """
    without_cache()
    yield machine()
    bundled, seconds = bundled_lenses(), {}
    for name in lenses or [name for name, each in bundled.items() if each.radial]:
        lens = turned(bundled[name]).prescription
        seconds[name] = (least_s(lambda name=name: baked(turned(bundled[name]).prescription, quality=quality,
                                                         wavelengths_nm=WAVELENGTHS_NM), 1)[0],
                         least_s(lambda lens=lens: ray_table(lens), 1)[0])
        yield f"{name:30}  bake {seconds[name][0]:6.2f} s  rays {seconds[name][1]:5.2f} s"
    for which, label in enumerate((f"bake at {quality}", "table of rays")):
        worst = max(seconds, key=lambda name: seconds[name][which])
        yield (f"{label}: median {np.median([each[which] for each in seconds.values()]):.2f} s, "
               f"worst {seconds[worst][which]:.2f} s ({worst})")


def rack(lenses=RACKED, *, quality: str = "preview") -> Iterator[str]:
    """Processor seconds of the lens in a rack focus, mean and worst frame, for each lens and number of wavelengths.

    Focus moves from infinity to the closest distance in 24 frames, in equal steps of reciprocal distance. Nothing is
    cached, and the table of rays is not included. By default, some fast and some slow lenses are baked.
    """
    without_cache()
    yield machine()
    for name in lenses:
        far, near = ring_ends(prescription_of(name))
        with np.errstate(divide="ignore"):
            focus_mm = 1 / np.linspace(1 / far.focus_mm, 1 / near.focus_mm, FRAMES)
        for wavelengths_nm in PICTURES_NM:
            frames_s = [least_s(partial(load_lens, name, Rings(each_mm), quality, wavelengths_nm=wavelengths_nm), 1)[0]
                        for each_mm in focus_mm]
            yield (f"{name:30}  {wavelengths_nm.size:3} wavelengths: {np.mean(frames_s):.2f} s a frame, "
                   f"worst {max(frames_s):.2f} s")


def grid(lenses=("cooke-triplet-50mm", "nikkor-28mm", "angenieux-50mm")) -> Iterator[str]:
    """The cost of a lens without rotational symmetry, relative to a rotationally symmetric one with the same PSFs.

    Processor seconds of both, cold, for a picture at 1080p with 12 wavelengths and an accuracy of 0.01, as the quickest
    of alternate runs. The ratio may be at most 2.
    """
    without_cache()
    yield machine()
    yield f"{'processor seconds':<24}{'symmetric':>12}" + "".join(f"{kind:>22}" for kind in KINDS)
    for name in lenses:
        lens = load_lens(name)
        radiance = night_street(lens, HD, np.linspace(420, 680, WAVELENGTHS))
        alike = [lens, *(on_grid(lens, mirrored=mirrored) for mirrored in KINDS.values())]
        radial_s, *grid_s = np.min([[cold_run(radiance, each, Options(accuracy=ACCURACY)).processor_s for each in alike]
                                    for _ in range(BEST_OF)], axis=0)
        yield f"{name:<24}{radial_s:10.1f} s" + "".join(
            marked(f"{seconds:10.1f} s, {seconds / radial_s:5.2f} x", seconds > MOST * radial_s) for seconds in grid_s)


def sensor(*, times: int = 5) -> Iterator[str]:
    """Processor seconds of the raw picture of a sensor, 12 megapixels of 12 wavelengths, by sensor and by light.

    Each figure is the least of several exposures. Few electrons take longer than many.
    """
    yield machine()
    for kind, camera in SENSORS.items():
        for name, (mean_e, pitch_um, noise) in LIGHTS.items():
            picture, exposure = light(camera, mean_e, pitch_um), Exposure(SHUTTER_S, 100.0, noise=noise)
            processor_s, waited_s = least_s(partial(expose, picture, camera, exposure), times)
            yield f"{kind:12} {name:28} {processor_s:5.2f} processor s, {waited_s:5.2f} s"


def light(camera: Camera, mean_e: float, pitch_um: float) -> SpectralImage:
    """Irradiance that frees this mean number of electrons, with a gradient across the picture."""
    shape = tuple(round(n * PITCH_UM / pitch_um) for n in SHAPE_PX)
    level = mean_e / (SHUTTER_S * response(camera, NM)[1].sum())
    rows = np.full((NM.size, *shape), level, np.float32) * np.linspace(0.5, 1.5, shape[1], dtype=np.float32)
    return SpectralImage(rows, NM, pitch_um=pitch_um, quantity="irradiance")
