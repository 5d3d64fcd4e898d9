"""Copies of lenses with a tilted sensor, by rayoptics' and Optiland's own decentres and tilts.

    .venv-bake/bin/python -W ignore tests/engine/bake/displaced_witness.py

prints the differences that docs/guide/engineer.md states. Both programs get the design of a copy of grade "dropped",
focused at 5 m, and object points in focus. They aim rays at the stop, by Newton's method, and trace them to the sensor.
"""

from typing import NamedTuple

import numpy as np
from optiland.rays import RealRays
from rayoptics.raytr.raytrace import trace_raw

from lensfield.engine.bake.sampling import sensor_mm
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.tolerances import Copy
from lensfield.engine.rays.fields import find_fields, trace_fields, undisturbed, view_of
from lensfield.engine.rays.focus import build_system
from lensfield.engine.rays.rays import FullPupil
from lensfield.engine.rays.rings import Rings, turned
from optiland_witness import displaced_optic
from rayoptics_witness import path_of

NM = 550.0
RINGS = Rings(focus_mm=5000.0, tilt_deg=(1.5, -2.0), copy=Copy(28, "dropped"))
SHARES = np.array([(0.0, 0.0), (0.7, 0.0), (-0.6, 0.8), (0.4, -0.9)]).T  # of half the sensor's width and height
PUPIL = FullPupil(3, 6)
BEFORE_MM = 100.0  # start of rays in front of the first vertex
NEWTON_STEPS, STEP_MM, AIMED_MM = 5, 1e-4, 1e-9
MOST_MM, MOST_WAVES = 1e-6, 1e-3


class Difference(NamedTuple):
    """The largest differences between two programs: of chief rays on the sensor, and of path differences to them."""

    chief_mm: float
    waves: float


def by_rayoptics(system):
    """Trace rays (3, ray), relative to the first vertex: their points on the stop and on the sensor, and paths."""
    path, stop = path_of(system, NM, BEFORE_MM), system.prescription.stop_index + 1

    def trace(start, direction):
        traced = [trace_raw(iter(path), *ray, NM)[:2] for ray in zip(start.T + [0, 0, BEFORE_MM], direction.T,
                                                                     strict=True)]
        on_stop, on_sensor = (np.array([ray[surface][0][:2] for ray, _ in traced]).T for surface in (stop, -1))
        return on_stop, on_sensor, np.array([path_mm for _, path_mm in traced])

    return trace


def by_optiland(system):
    """As `by_rayoptics`; the stop is not displaced."""
    optic, _ = displaced_optic(system.prescription, system.indices_at([NM])[:, 0])
    stop = system.prescription.stop_index + 1

    def trace(start, direction):
        rays = RealRays(*start, *direction, np.ones(start.shape[1]), np.full(start.shape[1], NM * 1e-3))
        optic.surfaces.trace(rays)
        optic.surfaces[-1].geometry.cs.localize(rays)
        return np.stack([optic.surfaces.x[stop], optic.surfaces.y[stop]]), np.stack([rays.x, rays.y]), rays.opd

    return trace


def aimed_rays(system, trace, direction, nearness, stop_mm):
    """Points on the sensor (2, ray), and paths, of rays through points of the stop (2, ray).

    They come from object points in these directions (3, ray) from the entrance pupil, at these inverse depths (ray,).
    """
    eye_mm = np.array([[0.0], [0.0], [system.entrance_pupil_mm]])

    def traced(aim_mm):
        from_eye = np.stack([*aim_mm, np.zeros_like(aim_mm[0])])
        away = direction + nearness * from_eye
        length = np.linalg.norm(away, axis=0)
        along = away / length
        back_mm = (eye_mm[2] + BEFORE_MM) / along[2]
        on_stop, on_sensor, path_mm = trace(eye_mm + from_eye - back_mm * along, along)
        return on_stop, on_sensor, length / nearness - back_mm + path_mm

    aim_mm = np.stack([place_mm * abs(section.marginal_heights_mm[0]) / system.stop_semi_aperture_mm
                       + tangent * (system.entrance_pupil_mm - section.entrance_pupil_mm) for place_mm, tangent, section
                       in zip(stop_mm, direction[:2] / direction[2], (system.across, system), strict=True)])
    for _ in range(NEWTON_STEPS):
        on_stop, by_x, by_y = (traced(aim_mm + np.reshape(step, (2, 1)))[0]
                               for step in ((0.0, 0.0), (STEP_MM, 0.0), (0.0, STEP_MM)))
        change = np.stack([by_x - on_stop, by_y - on_stop], axis=-1).swapaxes(0, 1) / STEP_MM
        aim_mm = aim_mm - np.linalg.solve(change, (on_stop - stop_mm).T[..., None])[..., 0].T
    on_stop, on_sensor, path_mm = traced(aim_mm)
    np.testing.assert_allclose(on_stop, stop_mm, rtol=0, atol=AIMED_MM)
    return on_sensor, path_mm


class Displaced:
    """A copy of a lens, and the engine's rays from object points to places on the sensor.

    Attributes
    ----------
    system : System
    position_mm : array (2, place, ray)
        On the sensor; the chief ray is first.
    path_mm : array (place, ray)
    passing : bool array (place, ray)
    """

    def __init__(self, name):
        self.system = build_system(turned(prescription_of(name), RINGS).prescription)
        self._view = view_of(self.system)
        self._places_mm = SHARES * np.reshape(sensor_mm(self.system), (2, 1)) / 2
        self._points = find_fields(self.system, self._view, self._places_mm, [NM])
        self.position_mm, self.path_mm, self.passing = self._rays(self.system)
        if not self.passing[:, 0].all():
            raise ValueError(f"{name}: the rim blocks a chief ray: choose other SHARES")

    def _rays(self, system):
        rays = trace_fields(system, self._view, self._points, PUPIL)
        passing = np.all(rays.square_height_mm2 <= system.semi_apertures_mm.reshape(-1, 1, 1, 1, 1)**2, axis=0)
        arrays = (np.moveaxis(rays.position_mm, 0, -1), rays.path_mm, passing & ~rays.lost)
        position, path_mm, passing = (each[0].reshape(SHARES.shape[1], PUPIL.x.size, *each.shape[4:])
                                      for each in arrays)
        return np.moveaxis(position, -1, 0), path_mm, passing

    def from_program(self, tracer):
        """The Difference from a program's rays."""
        place, ray = np.nonzero(self.passing)
        stop_mm = self.system.stop_semi_aperture_mm * np.stack([PUPIL.x.ravel()[ray], PUPIL.y.ravel()[ray]])
        direction = self._view.directions(self._points.tangent[:, 0, place])
        on_sensor, path_mm = aimed_rays(self.system, tracer(self.system), direction, self._points.nearness[0, place],
                                        stop_mm)
        away_mm = np.full(self.passing.shape, np.nan)
        away_mm[self.passing] = path_mm - self.path_mm[self.passing]
        return _difference(on_sensor[:, ray == 0] - self._view.origin_mm[:, None] - self._places_mm, away_mm)

    def from_design(self):
        """The Difference from the lens without displacements of its elements: their effect."""
        position_mm, path_mm, passing = self._rays(undisturbed(self.system))
        away_mm = np.where(passing & self.passing, path_mm - self.path_mm, np.nan)
        return _difference((position_mm - self.position_mm)[..., 0], away_mm)


def _difference(chief_mm, path_mm):
    """The Difference from differences of chief rays (2, place) and of paths (place, ray), NaN for blocked rays."""
    from_chief_mm = np.abs(path_mm - path_mm[:, :1])
    return Difference(np.hypot(*chief_mm).max(), np.nanmax(from_chief_mm) / (NM * 1e-6))


CASES = {
    "cooke-triplet-50mm": by_rayoptics, "zeiss-planar-50mm-f1.4": by_rayoptics, "nikkor-28mm": by_rayoptics,
    "meyer-orestor-135mm": by_rayoptics, "nikkor-58mm-f1.4": by_rayoptics,
    "cooke-42mm-2x": by_optiland, "panavision-21mm-1.3x": by_optiland}


def main():
    print(f"| lens | program | chief rays: limit {MOST_MM:g} mm | wavefront: limit {MOST_WAVES:g} waves | "
          "displacements move chief rays by | and the wavefront by |\n|---|---|---|---|---|---|")
    for name, tracer in CASES.items():
        lens = Displaced(name)
        ours, effect = lens.from_program(tracer), lens.from_design()
        print(f"| `{name}` | {tracer.__name__[3:]} | {ours.chief_mm:.1g} mm | {ours.waves:.1g} | "
              f"{effect.chief_mm:.2g} mm | {effect.waves:.2g} waves |", flush=True)


if __name__ == "__main__":
    main()
