"""What `make bench` is made of works: a case is measured, and the points that a plan does worst are found."""

import json
import subprocess
import sys

from places import ROOT

BENCHMARKS = ROOT / "benchmarks"


def said(*command):
    """The last line that Python prints."""
    done = subprocess.run([sys.executable, *command], cwd=BENCHMARKS, check=True, capture_output=True, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def test_a_case_is_measured():
    task = {"name": "380x253 x 31, 0.01", "options": {"accuracy": 0.01}, "best_of": 1, "wavelengths": 1, "frames": 2,
            "floor": True}
    facts = said("measure_case.py", json.dumps(task))
    assert min(facts[each] for each in ("processor_s", "waited_s", "later_s", "floor_s")) > 0
    assert 0 < facts["bound"] <= 0.01
    assert facts["engine"] == str(ROOT / "engine")


def test_the_worst_points_come_near_the_bound_and_not_above_it():
    bound, worst = said("-c", "import worst_points as points; points.LOOKED_AT = 60\n"
                              "points.SHAPE_PX, points.WAVELENGTHS_NM = (96, 128), (550.0,)\n"
                              "print(list(points.bound_and_worst('edmund-54852', 0.1)))")
    assert bound / 4 < worst <= bound <= 0.1


def test_the_table_of_rays_is_measured():
    done = subprocess.run([sys.executable, "ray_table_figures.py", "tessar-50mm"], cwd=BENCHMARKS, check=True,
                          capture_output=True, text=True)
    line = done.stdout.splitlines()[-1]
    assert line.startswith("tessar-50mm") and "3.9 MB" in line and line.endswith("wrong side 0.00%")
