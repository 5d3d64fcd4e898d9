"""Annotations of the same frames by BlenderProc and by Lensfield, compared.

    python validation/blenderproc_frames.py BLENDERPROC.json LENSFIELD.json

prints the largest distance between edges of boxes, and the smallest overlap of masks. It exits with status 1 if the
former exceeds a pixel, or the objects differ. `make validate-blenderproc` renders both.
"""

import sys

import numpy as np
from pycocotools.coco import COCO

LIMIT_PX = 1.0


def annotations(path):
    """The annotations of each picture, in the order of the frames: lists of (category, box, mask)."""
    coco = COCO(path)
    return [[(each["category_id"], np.array(each["bbox"]), coco.annToMask(each) > 0)
             for each in coco.loadAnns(coco.getAnnIds(image))] for image in sorted(coco.imgs)]


def edges(box):
    """Left, top, right and lower edge of a box."""
    return np.concatenate([box[:2], box[:2] + box[2:]])


def overlap(one, other):
    """Intersection over union of two masks."""
    return (one & other).sum() / (one | other).sum()


def compared(ours, theirs):
    """(distance in pixels, overlap) of each annotation and the one of its category that overlaps it most."""
    for category, box, mask in theirs:
        candidates = [each for each in ours if each[0] == category]
        if not candidates:
            yield np.inf, 0.0
            continue
        _, other_box, other = max(candidates, key=lambda each: overlap(each[2], mask))
        yield np.abs(edges(box) - edges(other_box)).max(), overlap(other, mask)


def main(arguments):
    theirs, ours = (annotations(path) for path in arguments)
    same = [len(each) for each in ours] == [len(each) for each in theirs]
    pairs = [pair for one, other in zip(ours, theirs, strict=False) for pair in compared(one, other)]
    missed_px, overlaps = np.array(pairs).T
    print(f"{len(theirs)} frames, {len(pairs)} annotations{'' if same else ' (others by Lensfield)'}: boxes differ by "
          f"up to {missed_px.max():g} px, masks overlap by at least {overlaps.min():.1%}")
    return int(not same or missed_px.max() > LIMIT_PX)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
