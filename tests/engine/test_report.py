"""Reports: stage times and facts."""

import json

import numpy as np
import pytest

from lensfield.engine import Report
from lensfield.engine import report as report_module
from lensfield.engine.report import FileFacts


@pytest.fixture
def clock(monkeypatch):
    """Sets the times that the clock shows, one reading after another."""
    def show(*times):
        readings = iter(times)
        monkeypatch.setattr(report_module.time, "perf_counter", lambda: next(readings))
    return show


def test_a_stage_does_not_count_the_stages_inside_it(clock):
    clock(0.0, 1.0, 4.0, 5.0, 7.0, 10.0)
    report = Report()
    with report.stage("outer"):
        with report.stage("inner"):
            pass
        with report.stage("other"):
            pass
    assert report.stages == {"inner": 3.0, "other": 2.0, "outer": 5.0}
    assert report.as_dict()["total_s"] == 10.0


def test_a_stage_that_comes_again_adds_up(clock):
    clock(0.0, 1.0, 5.0, 7.0)
    report = Report()
    for _ in range(2):
        with report.stage("again"):
            pass
    assert report.stages == {"again": 3.0}


def test_a_stage_that_fails_is_still_timed(clock):
    clock(0.0, 1.0, 3.0, 4.0)
    report = Report()
    with pytest.raises(KeyError), report.stage("outer"), report.stage("inner"):
        raise KeyError
    assert report.stages == {"inner": 2.0, "outer": 2.0}


def test_a_written_report_reads_back(tmp_path):
    report = Report()
    report.file = FileFacts("triplet.exr", (3, np.inf), None)
    with report.stage("only"):
        pass
    report.write(tmp_path / "new" / "report.json")
    told = json.loads((tmp_path / "new" / "report.json").read_text())
    assert told == report.as_dict() and told["radiance"] == "triplet.exr" and told["overscan_needed_px"] == [3, None]
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["report.json"]


def test_a_report_that_cannot_be_written_leaves_the_old_one_alone(tmp_path):
    path = tmp_path / "report.json"
    path.write_text("old")
    report = Report()
    report.file = FileFacts(object(), (0, 0), None)
    with pytest.raises(TypeError):
        report.write(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
