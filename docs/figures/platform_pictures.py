"""The icon and the featured picture of packaging/platform, for the page of an extensions platform.

    python docs/figures/platform_pictures.py FOLDER

The featured picture shows the night portrait of the front page through its three lenses, rendered at full size by Cycles;
`make platform-pictures` does that with Blender's wheel, in build/platform (ten minutes on two cores). A capture and lens
images that exist in FOLDER are reused. `make ui-test STEPS="install platform_pictures"` takes the other pictures.
"""

import sys
from pathlib import Path

import bpy
import numpy as np
from hero_pictures import ROOT, SCENE, SIDE_BY_SIDE, capture, portrait
from PIL import Image

from lensfield import addon

PLATFORM = ROOT / "packaging" / "platform"

FEATURED_PX, FEATURED_GAP_PX, FEATURED_QUALITY = (1920, 1080), 12, 88
PORTRAIT_PX = (FEATURED_PX[0] - (len(SIDE_BY_SIDE) - 1) * FEATURED_GAP_PX) // len(SIDE_BY_SIDE), FEATURED_PX[1]

ICON_PX, FINER = 256, 8
PLATE, ROUNDING = (22, 26, 36), 0.22  # the icon's background, and the radius of its corners in widths of the icon
MIDDLE, EDGE = np.array([255, 214, 140]), np.array([255, 122, 60])  # colours of a disc on the axis and in a corner
SPACING, RADIUS = 0.285, 0.137  # of the discs, in widths of the icon
VIGNETTING = 0.36  # shift of the two rims that cut a disc, in radii for each spacing from the axis


def icon():
    """Nine lights out of focus, as a lens shows them: round on the axis, cat's eyes towards the corners."""
    side = ICON_PX * FINER
    y, x = np.mgrid[:side, :side] / side + 0.5 / side - 0.5
    beyond = np.hypot(*(np.maximum(np.abs(axis) - (0.5 - ROUNDING), 0) for axis in (x, y)))
    pixels = np.zeros((side, side, 4), "uint8")
    pixels[beyond < ROUNDING] = *PLATE, 255
    for column, row in np.ndindex(3, 3):
        across, down = column - 1, row - 1
        away = np.hypot(across, down)
        shifts = [sign * VIGNETTING * RADIUS * np.array([across, down]) for sign in (-1, 1)]
        inside = [np.hypot(x - SPACING * across - dx, y - SPACING * down - dy) < RADIUS for dx, dy in shifts]
        pixels[inside[0] & inside[1], :3] = MIDDLE + (EDGE - MIDDLE) * away / np.sqrt(2)
    return Image.fromarray(pixels).resize((ICON_PX, ICON_PX), Image.Resampling.BOX)


def featured(folder):
    """The night portrait through three lenses, side by side."""
    bpy.ops.wm.open_mainfile(filepath=str(SCENE))
    radiance = capture(bpy.context.scene, folder / "capture", PORTRAIT_PX)
    sheet = Image.new("RGB", FEATURED_PX, "white")
    for index, lens in enumerate(SIDE_BY_SIDE):
        sheet.paste(portrait(lens, radiance, folder), (index * (PORTRAIT_PX[0] + FEATURED_GAP_PX), 0))
    return sheet


if __name__ == "__main__":
    icon().save(PLATFORM / "icon.png", optimize=True)
    addon.register()
    featured(Path(sys.argv[1])).save(PLATFORM / "featured.jpg", quality=FEATURED_QUALITY, optimize=True)
    addon.unregister()
