"""The numbers of enums: Blender's pictures and buttons pass them through single precision."""

import bpy
import numpy as np
import pytest

from lensfield.addon import _CLASSES

ENUMS = {f"{cls.__name__}.{name}": annotation.keywords["items"] for cls in _CLASSES
         for name, annotation in getattr(cls, "__annotations__", {}).items()
         if annotation.function is bpy.props.EnumProperty}


def numbers(items):
    """The numbers of an enum's items, as Blender stores them."""
    listed = items(None, bpy.context) if callable(items) else items
    return [item[-1] if len(item) > 3 else place for place, item in enumerate(listed)]


def test_the_enums_of_lenses_and_cameras_are_among_them():
    names = {"LensfieldCameraSettings.lens", "LensfieldCameraSettings.body", "LENSFIELD_OT_search_lens.lens"}
    assert names <= ENUMS.keys()


@pytest.mark.parametrize("enum", ENUMS)
def test_numbers_differ_and_fit_single_precision(enum):
    stored = numbers(ENUMS[enum])
    assert len({*stored}) == len(stored)
    assert [int(np.float32(number)) for number in stored] == stored
