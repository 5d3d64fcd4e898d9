"""What the table of rays takes, and how far from the lens's own rays it is: each bundled prescription.

    python benchmarks/ray_table_figures.py [LENS ...]

Object points at the lens's focus are traced at random through the stop, at wavelengths that the table was not traced
at. The table's rays are looked up where these land, and miss the points: by so much on the sensor (um), and in the path
against the chief ray's (waves): median, 99 % and largest, of the rays that pass. "Lost": of rays through the stop, what
does not reach the sensor, apertures aside. "Wrong side": what the table has passing and the lens stops, or the other
way round; where another ray goes through the same places of stop and sensor, and not through the lens, the table has
the one that does. Seconds are the processor's, of all cores together.
"""

import argparse
import time

import numpy as np
from timing import machine

from lensfield.engine.bake.focus import build_system
from lensfield.engine.bake.prescriptions import read_prescription
from lensfield.engine.bake.ray_table import ray_table
from lensfield.engine.bake.rays import HalfPupil, trace_pupil
from lensfield.engine.library import BUNDLED

WAVELENGTHS_NM = (450.0, 550.0, 650.0)
POINTS, RAYS = 40, 600
ANOTHER_UM = 300.0  # off, and it is another ray
STEP = 1e-4  # of a field, for the scale of the picture


def random_stop(rng):
    """Places evenly over one half of the stop, the first in its middle."""
    stop = HalfPupil(1, RAYS)
    radius, azimuth = np.sqrt(rng.uniform(0, 1, RAYS)), rng.uniform(0, np.pi, RAYS)
    radius[0] = 0
    stop.x, stop.y = (radius * each[None] for each in (np.sin(azimuth), np.cos(azimuth)))
    return stop


def misses(system, table):
    """Of the table's rays: um on the sensor, waves, who passes, where table and lens disagree on that, who is lost."""
    rng = np.random.default_rng(1)
    stop = random_stop(rng)
    heights_mm = np.sort(rng.uniform(0.01, 0.99, POINTS)) * system.last_height_mm
    true = trace_pupil(system, heights_mm, WAVELENGTHS_NM, stop)
    known = ~true.lost & (np.hypot(*true.position_mm) <= table.last_height_mm)
    passing = known & np.all(true.square_height_mm2 <= system.semi_apertures_mm.reshape(-1, 1, 1, 1, 1)**2, axis=0)
    rays = table.at(WAVELENGTHS_NM).rays(np.arange(3)[:, None, None, None], np.where(known, true.position_mm, 0.0),
                                         np.stack([stop.x, stop.y]))
    fields = system.fields_of(heights_mm)
    off, to_entrance_mm = (off_angles if system.object_at_infinity else off_points)(system, rays, fields[:, None, None])
    um = 1e3 * np.hypot(*(each * scale_mm[..., None, None] for each, scale_mm in
                          zip(off, scales_mm(system, heights_mm, fields), strict=True)))
    path_mm = to_entrance_mm + rays.path_mm - true.path_mm
    waves = np.abs(path_mm - path_mm[..., :1]) * 1e6 / np.reshape(WAVELENGTHS_NM, (3, 1, 1, 1))
    return um, waves, passing, ((rays.margin > 0) != passing) & known & (um < ANOTHER_UM), true.lost


def off_angles(system, rays, fields):
    """By what angles rays miss distant points, and the path from a plane wave to the entrance."""
    x, y, z = rays.direction
    return (x, y * np.cos(fields) - z * np.sin(fields)), rays.entrance_mm[1] * np.sin(fields)


def off_points(system, rays, fields):
    """By how many mm rays miss near points, and the path from these to the entrance."""
    depth_mm = system.prescription.object_distance_mm + system.entrance_pupil_mm
    x, y = rays.entrance_mm - depth_mm * rays.direction[:2] / rays.direction[2]
    to_entrance_mm = np.sqrt(rays.entrance_mm[0]**2 + (rays.entrance_mm[1] - fields)**2 + depth_mm**2)
    return (x, y - fields), to_entrance_mm


def scales_mm(system, heights_mm, fields):
    """mm on the sensor across and along the field's direction, for what `off_angles` or `off_points` tell."""
    before, here, after = (trace_pupil(system, system.heights_of(fields * share), WAVELENGTHS_NM,
                                       HalfPupil(1, 1)).chief_height_mm for share in (1 - STEP, 1, 1 + STEP))
    return here / (np.sin(fields) if system.object_at_infinity else fields), (after - before) / (2 * STEP * fields)


def spread(values):
    return " ".join(f"{each:6.4f}" for each in (*np.quantile(values, (0.5, 0.99)), values.max()))


def figures(path):
    prescription = read_prescription(path)
    start = time.process_time()
    table = ray_table(prescription)
    took = time.process_time() - start
    um, waves, passing, wrong, lost = misses(build_system(prescription), table)
    return (f"{path.stem:20s} {took:4.1f} s, {table.coefficients.nbytes / 1e6:.1f} MB; {spread(um[passing])} um, "
            f"{spread(waves[passing])} waves; lost {lost.mean():.2%}, wrong side {wrong.mean():.2%}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("lenses", nargs="*", metavar="LENS")
    asked = parser.parse_args()
    print(machine())
    folder = BUNDLED / "prescriptions"
    for path in [folder / f"{lens}.toml" for lens in asked.lenses] or sorted(folder.glob("*.toml")):
        print(figures(path), flush=True)


if __name__ == "__main__":
    main()
