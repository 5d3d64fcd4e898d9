"""Compare the sample scene before and after the lens, for docs/gallery.md, from the two pictures of `make demo`.

    python docs/figures/before_after.py demo docs

One sheet shows the frame through a perfect pinhole and through the lens, the other an enlarged corner of both.
"""

import sys
from pathlib import Path

from PIL import Image

CORNER_BOX = (0, 0, 256, 128)
ENLARGED = 3
GAP_PX = 8


def side_by_side(pictures):
    width, height = pictures[0].size
    sheet = Image.new("RGB", (2 * width + GAP_PX, height), "white")
    for index, picture in enumerate(pictures):
        sheet.paste(picture, (index * (width + GAP_PX), 0))
    return sheet


def main(demo, docs):
    pictures = [Image.open(next(demo.glob(f"*_{name}.png"))).convert("RGB") for name in ("before", "after")]
    corners = [picture.crop(CORNER_BOX).resize([ENLARGED * (CORNER_BOX[i + 2] - CORNER_BOX[i]) for i in (0, 1)],
                                               Image.Resampling.NEAREST) for picture in pictures]
    side_by_side(pictures).save(docs / "before_after.jpg", quality=88, optimize=True)
    side_by_side(corners).save(docs / "corner.png", optimize=True)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:3]))
