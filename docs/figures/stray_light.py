"""Pictures of docs/stray_light.md: the sun just in the frame and just out of it, through three lenses.

    python docs/figures/stray_light.py ZOOM.txt docs/stray_light.jpg

ZOOM.txt is Optical Bench's Nikkor 70-200 mm f/2.8E (WO 2019/097669, example 1), as the library has no zoom lens.
The scene is bright ground, a dark sky, and the sun, which is as bright as it is to such ground. In the fourth row, the
sun is a lamp of a single wavelength.
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from lensfield.engine import Options, Report, Rings, SpectralImage, load_lens
from lensfield.engine.image.sources import Sources
from lensfield.engine.lens.iris import Iris
from lensfield.engine.pictures.preview import srgb_pixels, to_rec709
from lensfield.engine.simulation.lens_image import lens_image
from lensfield.engine.stray.options import StrayOptions

NM = np.linspace(420, 680, 9)
WIDTH_PX, OVERSCAN_PX = 480, (12, 18)
LENSES = ("cooke-triplet-50mm", "none"), ("zeiss-biotar-50mm", "single")
SUN_RAD = 0.00465
SUN, GROUND = 1.5, 0.05  # irradiance at the lens, W m^-2 nm^-1, and radiance, W m^-2 sr^-1 nm^-1
PLACES = (0.8, 0.3), (1.12, 0.42)  # of half the frame, to the right and up
LAMP_NM = 550.0
IRIS = Iris(6, rotation_deg=8.0)
BRIGHTNESS, BRIGHT = 0.7, 0.97  # of the picture at this quantile of its pixels


def ideal_mm(lens, place):
    """A place of the ideal image, in halves of the frame, in mm."""
    return [share * side / 2 for share, side in zip(place, lens.sensor_mm, strict=True)]


def radiance(lens, place, spectrum):
    """A dark sky above the ground, and the sun if it is in the frame."""
    width_mm, height_mm = lens.sensor_mm
    shape, pitch_mm = (round(WIDTH_PX * height_mm / width_mm), WIDTH_PX), width_mm / WIDTH_PX
    captured = tuple(n + 2 * more for n, more in zip(shape, OVERSCAN_PX, strict=True))
    cube = np.full((NM.size, *captured), GROUND, np.float32)
    cube[:, :captured[0] // 2] = 0
    image = SpectralImage(cube, NM, pitch_um=pitch_mm * 1e3, overscan_px=OVERSCAN_PX,
                          focal_mm=lens.capture_focal_length_mm)
    right_mm, up_mm = ideal_mm(lens, place)
    x_mm, y_mm = image.grid.position_mm(*np.indices(captured))
    disc = np.hypot(x_mm - right_mm, y_mm - up_mm) < max(SUN_RAD * lens.capture_focal_length_mm, pitch_mm)
    solid_angle_sr = disc.sum() * (pitch_mm / lens.capture_focal_length_mm) ** 2
    cube[:, disc] = SUN * spectrum[:, None] / max(solid_angle_sr, 1e-12)
    return image


def sun(lens, place, spectrum):
    """The sun beyond the frame."""
    towards = np.array([*ideal_mm(lens, place), lens.capture_focal_length_mm])
    return Sources(towards[None] / np.linalg.norm(towards), np.array([np.inf]), SUN * spectrum[None], NM,
                   np.array([SUN_RAD]), ("Sun",))


def picture(name, coating, place, spectrum):
    """The lens image and its report."""
    lens, report = load_lens(name, Rings(f_number=8.0, coating=coating), "preview"), Report()
    beyond = max(place) > 1
    image, _ = lens_image(radiance(lens, place, spectrum), lens, Options(accuracy=0.05),
                          StrayOptions("ghosts,veil,star"), iris=IRIS,
                          outside=sun(lens, place, spectrum) if beyond else None, report=report)
    return image, report


def main(zoom, path):
    line = np.where(np.abs(NM - LAMP_NM) < 1, NM.size, 0).astype(float)
    rows = []
    lenses = *((*each, np.ones(NM.size)) for each in (*LENSES, (zoom, "multi"))), (*LENSES[0], line)
    for name, coating, spectrum in lenses:
        images = []
        for place in PLACES:
            image, report = picture(name, coating, place, spectrum)
            print(f"{name}, {coating}, sun at {place}:", *report.remarks(), sep="\n  ")
            rgb = to_rec709(image)
            images.append(srgb_pixels(rgb, BRIGHTNESS / np.quantile(rgb.max(axis=-1), BRIGHT)))
        rows.append(np.concatenate(images, axis=1))
    least = min(len(row) for row in rows)
    Image.fromarray(np.concatenate([row[:least] for row in rows])).save(path, quality=88, optimize=True)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
