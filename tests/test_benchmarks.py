"""The parts of `make bench`: measuring a case, and finding the points with a plan's largest error."""

import json
import subprocess
import sys

from places import ROOT

BENCHMARKS = ROOT / "benchmarks"


def json_output(*command):
    """The last line that Python prints."""
    completed = subprocess.run([sys.executable, *command], cwd=BENCHMARKS, check=True, capture_output=True, text=True)
    return json.loads(completed.stdout.splitlines()[-1])


def test_a_case_is_measured():
    task = {"name": "380x253 x 31, 0.01", "options": {"accuracy": 0.01}, "best_of": 1, "wavelengths": 1, "frames": 2}
    facts = json_output("measure_case.py", json.dumps(task))
    assert min(facts[each] for each in ("processor_s", "waited_s", "later_s")) > 0
    assert 0 < facts["bound"] <= 0.01


def test_the_worst_points_approach_the_bound_without_exceeding_it():
    bound, worst = json_output("-c", "import worst_points as points; points.LOOKED_AT = 60\n"
                                     "points.SHAPE_PX, points.WAVELENGTHS_NM = (96, 128), (550.0,)\n"
                                     "print(list(points.bound_and_worst('edmund-54852', 0.1)))")
    assert bound / 4 < worst <= bound <= 0.1
