"""The anamorphic lenses of the library: focal lengths and squeeze, far and near.

    python benchmarks/anamorphic_figures.py

prints for each lens the focal lengths of the picture's width and height, at infinity; its squeeze at the farthest and
at the closest focus, which is the ratio of the magnifications of height and width; and how far apart the paraxial foci
of the two sections are there. All figures are to first order.
"""

from lensfield.engine.library import bundled_lenses
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.rings import NEAREST_MM, Rings, in_metres, turned


def line(prescription) -> str:
    """A lens's line of the table."""
    ends = [turned(prescription, Rings(focus_mm)) for focus_mm in (float("inf"), NEAREST_MM)]
    far, near = (system_of(end.prescription) for end in ends)
    squeezes = "".join(f"{system.squeeze:9.3f}" for system in (far, near))
    apart_um = "".join(f"{1e3 * (system.across.image_distance_mm - system.image_distance_mm):8.0f} um"
                       for system in (far, near))
    return (f"{prescription.name:<28}{far.across.efl_mm:8.2f} x {far.efl_mm:6.2f} mm{squeezes}"
            f"{in_metres(ends[1].focus_mm):>9}{apart_um}")


if __name__ == "__main__":
    print(f"{'lens':<28}{'width x height':>20}{'squeeze':>9}{'near':>9}{'at':>9}{'apart':>11}{'near':>11}")
    for each in bundled_lenses().values():
        if not each.radial:
            print(line(each), flush=True)
