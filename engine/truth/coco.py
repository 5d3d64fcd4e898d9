"""Annotations of the objects in lens images, in the layout of the data set COCO: boxes and run-length masks.

The layout is described at cocodataset.org/#format-data, and pycocotools encodes the masks. COCO's boxes are x, y, width
and height in pixels, from the corner of the picture.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..runtime.errors import ImageError, InputError
from .captured_truth import ShownObject
from .cryptomatte import id_of

OBJECTS = "lensfield:objects"
"""Attribute of a file with the objects of its pixels."""
PACKAGE = "pycocotools"


def objects_text(objects: Mapping[str, ShownObject]) -> str:
    """The text of the attribute: JSON of {name: [category, instances]}."""
    return json.dumps({name: [each.category_id, each.instances] for name, each in sorted(objects.items())})


def objects_from(text: str) -> dict[str, ShownObject]:
    """The objects in the text of an attribute; raises a ValueError for another text."""
    try:
        objects = {name: ShownObject(*facts) for name, facts in json.loads(text).items()}
    except (AttributeError, TypeError, RecursionError):
        raise ValueError("not objects") from None
    if not all(type(number) is int for each in objects.values() for number in (each.category_id, each.instances)):
        raise ValueError("not whole numbers")
    return objects


def annotations_of(ids: np.ndarray, objects: Mapping[str, ShownObject],
                   categories: Mapping[str, int]) -> Iterator[dict[str, Any]]:
    """The annotations of one picture, without their numbers.

    Parameters
    ----------
    ids : float32 array (row, column)
        The Cryptomatte id of the object in each pixel.
    objects : mapping of str to ShownObject
    categories : mapping of str to int
        By the names of objects; other objects are not annotated.

    Yields
    ------
    dict
        In the order of names. A name with several instances is a crowd: its mask covers all of them.

    Raises
    ------
    ImageError
        A pixel shows none of the objects.
    """
    bits = np.ascontiguousarray(ids, np.float32).view(np.uint32)
    names = {int(id_of(name).view(np.uint32)): name for name in objects}
    visible = {int(each) for each in np.unique(bits)} - {0}
    if unknown := visible - names.keys():
        raise ImageError("ground truth", "objects", f"{len(unknown)} without a name", "render the frame again")
    for name, bits_of_name in sorted((names[each], each) for each in visible):
        if name in categories:
            yield {"category_id": categories[name], "object": name, "iscrowd": int(objects[name].instances > 1),
                   **_outline(bits == bits_of_name)}


def _outline(mask):
    """The box, the area and the run-length mask of some pixels."""
    coder = mask_coder()
    runs = coder.encode(np.asfortranarray(mask, np.uint8))
    return {"bbox": coder.toBbox(runs).tolist(), "area": int(coder.area(runs)),
            "segmentation": {"size": [int(side) for side in runs["size"]], "counts": runs["counts"].decode("ascii")}}


def mask_coder() -> Any:
    """The module `pycocotools.mask`; raises an InputError without the package."""
    try:
        from pycocotools import mask
    except ImportError:
        raise InputError("lensfield coco", PACKAGE, "not installed", f"pip install {PACKAGE}") from None
    return mask
