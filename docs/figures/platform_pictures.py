"""The icon and the pictures of packaging/platform, for the page of an extensions platform.

    python docs/figures/platform_pictures.py FOLDER

The featured picture shows the night portrait of the front page through its three lenses, rendered at full size by
Cycles; `make platform-pictures` does that with Blender's wheel, in build/platform (a quarter of an hour on two cores).
A capture and lens images that exist in FOLDER are reused. The other pictures are from the guide and the gallery.
"""

import sys
from pathlib import Path
from shutil import copyfile

import bpy
import numpy as np
from PIL import Image

from hero_pictures import DOCS, GALLERY, GALLERY_PX, ROOT, SCENE, SIDE_BY_SIDE, capture, portrait
from lensfield import addon

PLATFORM = ROOT / "packaging" / "platform"

FEATURED_PX, FEATURED_GAP_PX, QUALITY = (1920, 1080), 12, 88
PORTRAIT_PX = (FEATURED_PX[0] - (len(SIDE_BY_SIDE) - 1) * FEATURED_GAP_PX) // len(SIDE_BY_SIDE), FEATURED_PX[1]

COPIED = {"2_preview.jpg": "preview.jpg", "3_live.jpg": "live.jpg", "4_compositor.png": "compositor.png",
          "5_compare.jpg": "contact_sheet.jpg", "6_sheet.png": "sheet.png"}
"""Pictures of the guide, by their names here."""
COLUMNS, GAP_PX = 5, 6  # of the lenses side by side

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


def gallery():
    """The pictures of the gallery, side by side in two rows."""
    step = np.add(GALLERY_PX, GAP_PX)
    sheet = Image.new("RGB", tuple(step * (COLUMNS, len(GALLERY) // COLUMNS) - GAP_PX), "white")
    for index, lens in enumerate(GALLERY):
        row, column = divmod(index, COLUMNS)
        with Image.open(DOCS / "gallery" / f"{lens}.jpg") as picture:
            sheet.paste(picture, tuple(step * (column, row)))
    return sheet


def main(folder):
    icon().save(PLATFORM / "icon.png", optimize=True)
    gallery().save(PLATFORM / "1_lenses.jpg", quality=QUALITY, optimize=True)
    for name, source in COPIED.items():
        copyfile(DOCS / "guide" / "pictures" / source, PLATFORM / name)
    addon.register()
    featured(folder).save(PLATFORM / "featured.jpg", quality=QUALITY, optimize=True)
    addon.unregister()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
