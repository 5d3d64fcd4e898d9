"""Raw pictures of an even field through a lens, with noise, tilted illumination and a filter array."""

from dataclasses import replace

import numpy as np

from lensfield.engine import SpectralImage
from lensfield.engine.fitting.vignetting import light_of
from lensfield.engine.pictures.dng import MountedLens, write_dng
from lensfield.engine.prescription.photographs import Vignetting
from lensfield.engine.sensor.exposure import Exposure, expose
from raw_pictures import small_camera

NM = np.array([450.0, 550.0, 650.0])
SHAPE_PX = 480, 720


def flat_light(prescription, f_number, sensor_mm, tilt=(0.0, 0.0), focus_mm=np.inf, shape_px=SHAPE_PX):
    """Light on the pixels: of a lens, on a sensor with this diagonal, times 1 + tilt to the right and upwards, whose
    unit is half the diagonal."""
    rows, columns = shape_px
    down, right = np.meshgrid((np.arange(rows) + 0.5) * 2 - rows, (np.arange(columns) + 0.5) * 2 - columns,
                              indexing="ij")
    x, y = right / np.hypot(*shape_px), -down / np.hypot(*shape_px)
    shares = np.linspace(0.02, 0.999, 40)
    curve = Vignetting(f_number, focus_mm, shares * np.hypot(*sensor_mm) / 2, np.ones(shares.size))
    light, = light_of(prescription, [curve])
    radial = np.interp(np.hypot(x, y), np.append(0, shares), np.append(1, light))
    return radial * (1 + tilt[0] * x + tilt[1] * y)


def write_flat(path, light, mounted=None, level=0.6, seed=0, filters=("RG", "GB")):
    """Write a DNG of this light, whose brightest green pixels have a share `level` of saturation. The light is the same
    at all wavelengths `NM`, or a plane for each."""
    camera = small_camera(shape_px=light.shape[-2:], filters=filters)
    image = SpectralImage(np.broadcast_to(light, (NM.size, *light.shape[-2:])) * 1e-4, NM, pitch_um=camera.pitch_um,
                          quantity="irradiance")
    trial = expose(image, replace(camera, filters=()), Exposure(1e-4, camera.base_iso, noise=False))
    green = trial.numbers[camera.channels.index("G")].max() - trial.dark_dn
    shutter_s = 1e-4 * level * (trial.highest_dn - trial.dark_dn) / green
    raw = expose(image, camera, Exposure(float(shutter_s), camera.base_iso, seed=seed))
    write_dng(raw, path, mounted or MountedLens(""))


def mounted(focal_mm, f_number):
    return MountedLens("a lens", focal_mm, f_number)
