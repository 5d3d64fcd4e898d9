"""Measure the raw picture of a sensor: processor seconds for 12 megapixels of 12 wavelengths, by sensor and by light.

    python benchmarks/sensor_figures.py [TIMES]

Each figure is the least of several exposures, 5 without an argument. Few electrons take longer than many.
"""

import sys
from dataclasses import replace

import numpy as np
from timing import least_s, machine

from lensfield.engine import SpectralImage
from lensfield.engine.sensor.camera import Camera
from lensfield.engine.sensor.electrons import response
from lensfield.engine.sensor.exposure import Exposure, expose

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


def light(camera: Camera, mean_e: float, pitch_um: float) -> SpectralImage:
    """Irradiance that frees this mean number of electrons, with a gradient across the picture."""
    shape = tuple(round(n * PITCH_UM / pitch_um) for n in SHAPE_PX)
    level = mean_e / (SHUTTER_S * response(camera, NM)[1].sum())
    rows = np.full((NM.size, *shape), level, np.float32) * np.linspace(0.5, 1.5, shape[1], dtype=np.float32)
    return SpectralImage(rows, NM, pitch_um=pitch_um, quantity="irradiance")


def seconds(camera: Camera, mean_e: float, pitch_um: float, noise: bool, times: int) -> tuple[float, float]:
    """Processor seconds and wall-clock seconds of an exposure."""
    picture, exposure = light(camera, mean_e, pitch_um), Exposure(SHUTTER_S, 100.0, noise=noise)
    return least_s(lambda: expose(picture, camera, exposure), times)


def main(times: str = "5") -> None:
    """Print a line for each sensor and light."""
    print(machine())
    for sensor, camera in SENSORS.items():
        for name, settings in LIGHTS.items():
            processor_s, waited_s = seconds(camera, *settings, int(times))
            print(f"{sensor:12} {name:28} {processor_s:5.2f} processor s, {waited_s:5.2f} s", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
