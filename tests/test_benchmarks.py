"""The parts of `make bench`: measuring a case, and finding the points with a plan's largest error."""

import json
import subprocess
import sys

import pytest

from places import ROOT

pytestmark = pytest.mark.ci_only
BENCHMARKS = ROOT / "benchmarks"


def json_output(*command):
    """The last line that Python prints."""
    completed = subprocess.run([sys.executable, *command], cwd=BENCHMARKS, check=True, capture_output=True, text=True)
    return json.loads(completed.stdout.splitlines()[-1])


def test_every_measurement_exists():
    """Except for those that need another environment, with default arguments."""
    code = ("import figures; names = [each for module, each in figures.MODULES.items() if module != 'upsampling']\n"
            "print([len(figures.arguments(figures.measurement(name), ())) for each in names for name in each])")
    assert len(json_output("-c", code)) > 20


def test_a_case_is_measured():
    facts = json_output("figures.py", "case", "380x253 x 31, 0.01", "--best-of=1", "--wavelengths=1", "--frames=2")
    assert min(facts[each] for each in ("processor_s", "waited_s", "later_s")) > 0
    assert 0 < facts["bound"] <= 0.01


def test_the_whole_job_is_measured_by_stages():
    facts = json_output("figures.py", "job", "--one", "standard", "--size", "32x24", "--samples", "8")
    assert all(facts["stages"][name] > 0 for name in ("Cycles", "filter", "rest"))
    assert "of 8 samples" in facts["samples"]


def test_jobs_are_measured_on_a_device(tmp_path):
    command = [sys.executable, "-W", "ignore", "figures.py", "device", "cpu", "--size", "24x18", "--samples", "1",
               "--rounds", "1", "--jobs", "preview", "--output", tmp_path / "device"]
    printed = subprocess.run(command, cwd=BENCHMARKS, check=True, capture_output=True, text=True).stdout
    figures = json.loads((tmp_path / "device.json").read_text())["devices"]["CPU"]
    assert list(figures) == ["plain render", "preview"]
    for each in figures.values():
        assert each["renders"] == 1 and 0 < each["outside_wall_s"] < each["wall_s"]
    assert figures["preview"]["times_wall"] == figures["preview"]["wall_s"] / figures["plain render"]["wall_s"]
    table = (tmp_path / "device.md").read_text()
    assert "**CPU**" in table and "| preview |" in table and "\npreview " in printed


def test_cost_noise_and_bias_of_few_samples_are_measured():
    """The Cornell box, in passes of 8 of 16 samples at most: too small for its limits."""
    printed = subprocess.run([sys.executable, "-W", "ignore", "figures.py", "noise", "cornell", "--size", "32x32",
                              "--samples", "16", "--reference", "2", "--seeds", "2"], cwd=BENCHMARKS, check=True,
                             capture_output=True, text=True).stdout
    name, *cells = printed.splitlines()[-1].split()
    cost, whole, noise, of_all, ratio = (float(cell.rstrip("!")) for cell in cells[:5])
    assert name == "cornell" and cost > 0 and whole > 0
    assert ratio == pytest.approx(noise / of_all, abs=0.01) and 0.5 < ratio < 2
    assert "of 16 samples in 1 of 2 passes" in printed


def test_the_worst_points_approach_the_bound_without_exceeding_it():
    bound, worst = json_output("-c", "import errors as points; points.LOOKED_AT = 60\n"
                                     "points.SHAPE_PX, points.WAVELENGTHS_NM = (96, 128), (550.0,)\n"
                                     "print(list(points.bound_and_worst('edmund-54852', 0.1)))")
    assert bound / 4 < worst <= bound <= 0.1


def test_detail_makes_in_focus_light_as_sharp_as_the_lens():
    """The error of lamps and of an edge's MTF, without and with detail, and rims."""
    printed = subprocess.run([sys.executable, "figures.py", "sharpness", "edmund-54852"], cwd=BENCHMARKS, check=True,
                             capture_output=True, text=True).stdout
    lamps, mtf, _, sharper_lamps, sharper_mtf, rim = (float(cell.rstrip("%")) for cell in
                                                      printed.splitlines()[-1].split()[2:])
    assert lamps > 0.2 and mtf > 0.1
    assert sharper_lamps < 0.1 and sharper_mtf < 0.03 and rim < 1.0


def test_near_lamps_of_a_fisheye_are_where_counted_rays_land():
    """Its entrance pupil moves by diameters, and lamps in narrow blur with it; on the axis and at the frame's edge."""
    printed = subprocess.run([sys.executable, "figures.py", "blurred_lamps", "olympus-fisheye-8mm@2000:250"],
                             cwd=BENCHMARKS, check=True, capture_output=True, text=True).stdout
    lamps = [[float(cell.rstrip("%")) for cell in line.split()[-2:]] for line in printed.splitlines()[-7:]]
    assert all(misplaced < 0.1 and abs(radius) < 3 for misplaced, radius in lamps)


def test_stars_have_a_spike_for_each_direction_of_the_blades():
    printed = json_output("-c", "import stray; from lensfield.engine import load_lens\n"
                                "lens = load_lens('edmund-54852')\n"
                                "print([int(stray.star_line(lens, iris).split()[4]) for iris in stray.IRISES[:3]])")
    assert printed == [0, 10, 6]
