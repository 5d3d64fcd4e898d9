"""Out-of-focus discs of an anamorphic lens and of a mirror lens, by Optiland's rays.

    PYTHONPATH=validation .venv-bake/bin/python -W ignore tests/engine/bake/depth_witness.py

prints the figures in docs/depth.md. The lens comes from Lensfield's prescription: glasses, gaps at the focus, apertures
and the entrance pupil are the engine's. Pixels are squeezed as the lens is.
"""

import numpy as np
from optiland.rays import RealRays

from depth_second_truth import NM, Judged, dimmed
from foreign_lens import ForeignLens
from lensfield.engine import Rings, load_lens
from lensfield.engine.rays.focus import build_system
from optiland_witness import displaced_optic

ANAMORPHIC, MIRRORS = ("cooke-42mm-2x", 2000.0), ("nikkor-reflex-500mm", 8000.0)
"""Names, and distances in focus in mm."""
LAMPS = {ANAMORPHIC: [(depth_mm, *lamp) for depth_mm in (1000.0, 8000.0) for lamp in
                      ((0.0, False), (0.0, True), (0.12, False), (0.25, False))],
         MIRRORS: [(depth_mm, *lamp) for depth_mm in (5000.0, 30000.0) for lamp in
                   ((0.0, False), (0.0, True), (0.02, False), (0.04, False))]}
"""Depth, tangent of the angle from the axis, and whether an edge hides a part: it does on the axis only."""


class ForeignDesign(ForeignLens):
    """A baked lens whose prescription Optiland traces."""

    aim = 4.0  # the pupil of the width is in front of the other, and twice as wide

    def __init__(self, lens):
        system = build_system(lens.prescription)
        self._optic, _ = displaced_optic(system.prescription, system.indices_at([NM])[:, 0])
        self._semi_mm = system.semi_apertures_mm
        self._hole_mm = np.array([surface.semi_obstruction_mm for surface in system.prescription.surfaces])
        self._semi_mm[system.prescription.stop_index] = system.stop_semi_aperture_mm
        self.efl_mm, self.entrance_pupil_mm = system.efl_mm, system.entrance_pupil_mm
        self.entrance_pupil_radius_mm = abs(system.marginal_heights_mm[0])
        self.squeeze = lens.squeeze

    def _traced(self, aim_mm, direction):
        before_mm = self.entrance_pupil_mm + 2 * self.entrance_pupil_radius_mm
        place, count = aim_mm - direction[:2] / direction[2] * before_mm, direction.shape[1]
        rays = RealRays(*place, np.full(count, self.entrance_pupil_mm - before_mm), *direction, np.ones(count),
                        np.full(count, NM * 1e-3))
        with np.errstate(invalid="ignore"):
            self._optic.surfaces.trace(rays)
            inner = slice(1, -1)
            heights_mm = np.hypot(self._optic.surfaces.x[inner], self._optic.surfaces.y[inner])
            passing = np.all((heights_mm <= self._semi_mm[:, None]) & (heights_mm >= self._hole_mm[:, None]), axis=0)
        return np.stack([rays.x, rays.y]), passing & np.isfinite(rays.x)


class JudgedDesign(Judged):
    """One of the lenses in both programs."""

    def __init__(self, name, focus_mm):
        lens = load_lens(name, Rings(focus_mm), quality="preview", wavelengths_nm=[NM])
        self.lens, self.foreign = dimmed(lens), ForeignDesign(lens)


def main():
    for (name, focus_mm), lamps in LAMPS.items():
        judged = JudgedDesign(name, focus_mm)
        for depth_mm, tangent, hidden in lamps:
            print(f"{name}, {depth_mm:g} mm, tangent {tangent:g}{', behind an edge' * hidden}: "
                  f"{judged.lamp(depth_mm, tangent, hidden)}", flush=True)


if __name__ == "__main__":
    main()
