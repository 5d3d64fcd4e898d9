"""Pictures of docs/stray_light.md: the sun just in the frame and just out of it, through three lenses.

    python docs/stray_light.py ZOOM.txt docs/stray_light.jpg

ZOOM.txt is Optical Bench's Nikkor 70-200 mm f/2.8E (WO 2019/097669, example 1), as the library has no zoom lens.
The scene is a dark plane and the sun, which is as bright as on a clear day relative to it. A fourth row has a lamp of
a single wavelength.
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from lensfield.engine import Options, Report, Rings, SpectralImage, load_lens
from lensfield.engine.depth.iris import Iris
from lensfield.engine.pictures.preview import srgb_pixels, to_rec709
from lensfield.engine.simulation.lens_image import StrayFacts, lens_image
from lensfield.engine.stray.options import StrayOptions
from lensfield.engine.stray.sources import Sources

NM = np.linspace(420, 680, 9)
WIDTH_PX = 480
LENSES = ("cooke-triplet-50mm", "none"), ("zeiss-biotar-50mm", "single")
SUN_RAD = 0.00465
SUN, GROUND = 1.5, 0.05  # irradiance at the lens, W m^-2 nm^-1, and radiance, W m^-2 sr^-1 nm^-1
PLACES = (0.8, 0.3), (1.12, 0.42)  # of half the frame, to the right and up
LAMP_NM = 550.0
IRIS = Iris(6, rotation_deg=8.0)
EXPOSURE = 8.0  # of the ground's light: it is dark, so that stray light is visible


def sun(lens, place, spectrum):
    """The sun at a place of the ideal image, in halves of the frame."""
    right, up = (share * side / 2 / lens.capture_focal_length_mm
                 for share, side in zip(place, lens.sensor_mm, strict=True))
    towards = np.array([[right, up, 1.0]]) / np.sqrt(1 + right**2 + up**2)
    return Sources(towards, np.array([np.inf]), SUN * spectrum[None], NM, np.array([SUN_RAD]), ("Sun",))


def picture(name, coating, place, spectrum):
    """The lens image, and the report's remarks."""
    lens, report = load_lens(name, Rings(f_number=8.0, coating=coating), "preview"), Report()
    width_mm, height_mm = lens.sensor_mm
    shape = round(WIDTH_PX * height_mm / width_mm), WIDTH_PX
    ground = np.full((NM.size, *shape), GROUND, np.float32)
    ground[:, :shape[0] // 2] = 0
    light = SpectralImage(ground, NM, pitch_um=width_mm / WIDTH_PX * 1e3, focal_mm=lens.capture_focal_length_mm)
    image, _ = lens_image(light, lens, Options(accuracy=0.05), StrayOptions("ghosts,veil,star"), iris=IRIS,
                          outside=sun(lens, place, spectrum), report=report)
    return image, report


def main(zoom, path):
    line = np.where(np.abs(NM - LAMP_NM) < 1, NM.size, 0).astype(float)
    rows = []
    for name, coating, spectrum in (*((*each, np.ones(NM.size)) for each in (*LENSES, (zoom, "multi"))), (*LENSES[0], line)):
        images = []
        for place in PLACES:
            image, report = picture(name, coating, place, spectrum)
            print(f"{name}, {coating}, sun at {place}:", *report.remarks(), sep="\n  ")
            rgb = to_rec709(image)
            images.append(srgb_pixels(rgb, EXPOSURE / max(np.quantile(rgb[..., 1], 0.9), 1e-12) / 20))
        rows.append(np.concatenate(images, axis=1))
    least = min(len(row) for row in rows)
    Image.fromarray(np.concatenate([row[:least] for row in rows])).save(path, quality=88, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
