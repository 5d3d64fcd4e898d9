"""Reports: stage times and facts."""

import json
from dataclasses import replace

import numpy as np
import pytest

from lensfield.engine import Report
from lensfield.engine.blur.polar_sections import Sections
from lensfield.engine.depth.depth_range import DepthCheck
from lensfield.engine.plan.plan import Plan
from lensfield.engine.runtime.build_identity import software
from lensfield.engine.runtime.files import MARK
from lensfield.engine.simulation import report as report_module
from lensfield.engine.simulation.report_parts import Energy, FileFacts, LensImageFacts, Parts, SceneFacts, Upsampling


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


def test_a_repeated_stage_adds_up(clock):
    clock(0.0, 1.0, 5.0, 7.0)
    report = Report()
    for _ in range(2):
        with report.stage("again"):
            pass
    assert report.stages == {"again": 3.0}


def test_a_stage_that_fails_is_timed_too(clock):
    clock(0.0, 1.0, 3.0, 4.0)
    report = Report()
    with pytest.raises(KeyError), report.stage("outer"), report.stage("inner"):
        raise KeyError
    assert report.stages == {"inner": 2.0, "outer": 2.0}


def test_a_written_report_reads_back(tmp_path):
    report = Report()
    report.add(FileFacts("triplet.exr", (3, np.inf), None))
    with report.stage("only"):
        pass
    report.write(tmp_path / "new" / "report.json")
    contents = json.loads((tmp_path / "new" / "report.json").read_text())
    assert contents == {"format": "lensfield-report", "version": 1, "software": software()} | report.as_dict()
    assert contents["radiance"] == "triplet.exr" and contents["overscan_needed_px"] == [3, None]
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["report.json"]


def test_a_report_that_cannot_be_written_leaves_the_old_one_alone(tmp_path):
    path = tmp_path / "report.json"
    path.write_text(f"old. {MARK}")
    report = Report()
    report.add(FileFacts(object(), (0, 0), None))
    with pytest.raises(TypeError):
        report.write(path)
    assert path.read_text() == f"old. {MARK}"
    assert list(tmp_path.iterdir()) == [path]


def image_facts(**changes):
    plan = Plan(Sections(32, 64, 8), 3, np.inf, 0.0, "float32", np.inf, 0.0, False, "hold")
    facts = dict(lens="triplet", plan=plan, pitch_um=5.0, frame_px=(4, 6), overscan_px=(3, 8), wavelengths=(),
                 energy=Energy(1.0, 1.0, 1.0), out_of_field_fraction=0.0, fireflies_clamped=0, loops="numpy")
    return LensImageFacts(**facts | changes)


def file_facts(needed=(0, 0), negative=0.0):
    return FileFacts("a.exr", needed, Upsampling("RGB", (40.0, 30.0), [450.0, 550.0], negative))


def scene_facts(outside=0.0, **changes):
    depth = DepthCheck(5.0, 1000.0, np.inf, 500.0, 2000.0, outside)
    facts = dict(passes=1, wavelengths_per_pass=3, rendered_nm=[], wavelengths_nm=[], scene_plan="", lamps=[],
                 predicted_colour_error=0.0, predicted_sensor_error=0.0, predicted_spectral_error=0.0,
                 spectral_surprise=1.0, foreign_spectra=False, estimated_colour_error=0.0, depth=depth, lens_warning="")
    return SceneFacts(**facts | changes)


@pytest.mark.parametrize("facts, remark", [
    ([scene_facts()], None),
    ([scene_facts(foreign_spectra=True)], "spectra that the plan did not predict"),
    ([scene_facts(lens_warning="twice as large")], "twice as large"),
    ([scene_facts(outside=0.25)], "In focus: 1 m to infinity, within "),
    ([scene_facts(outside=0.25, layers="3 slabs, cut at 1, 2 m")], "3 slabs, cut at 1, 2 m"),
    ([replace(file_facts(), depth=scene_facts(outside=0.25).depth)], "out of focus: 25.0% of the frame"),
    ([replace(file_facts(), depth=scene_facts(outside=0.25).depth, layers="cut at 1 m")], "cut at 1 m"),
    ([image_facts()], None),
    ([image_facts(out_of_field_fraction=0.125)], "12.5% of the frame is outside the lens data: its edge continues"),
    ([image_facts(energy=Energy(0.0, 0.0, 0.0))], "black: the radiance is zero everywhere"),
    ([image_facts(energy=Energy(1.0, 1.0, 0.0))], "black: no light reaches the frame"),
    ([image_facts(energy=Energy(0.0, 0.0, 0.0)), scene_facts()], None),
    ([image_facts(), file_facts((3, 8))], None),
    ([image_facts(), file_facts((4, 8))], "needs 8 x 4 px of overscan on each side, the picture has 8 x 3"),
    ([image_facts(), file_facts((3, 9))], "needs 9 x 3 px of overscan on each side, the picture has 8 x 3"),
    ([file_facts(negative=0.0009)], None),
    ([file_facts(negative=0.0011)], "0.1% of the light would be negative")], ids=str)
def test_each_loss_and_nothing_else_gets_a_remark(facts, remark):
    remarks = Report(parts=Parts(facts)).remarks()
    assert len(remarks) == (remark is not None) and all(remark in line for line in remarks)


def test_a_sequence_lists_the_remarks_of_its_frames_once():
    frames = {number: Report(parts=Parts([image_facts(out_of_field_fraction=fraction)]))
              for number, fraction in ((1, 0.1), (2, 0.1), (3, 0.2))}
    report = Report(frames=frames)
    assert report.remarks() == ["frame 1: 10.0% of the frame is outside the lens data: its edge continues (2 similar)"]
    assert Report(frames={n: frames[1] for n in (1, 2)}).remarks() == frames[1].remarks()
    assert Report(frames=frames | {1: Report()}).remarks()[0].startswith("frame 2: 10.0% ")
    assert Report(frames={1: frames[1], 2: Report()}).remarks()[0].endswith("its edge continues")
    contents = report.as_dict()
    assert (contents["lens"], contents["out_of_field_fraction"], len(contents["frames"])) == ("triplet", 0.2, 3)
    assert contents["plan"]["method"] == "sections" and contents["frames"][2]["frame"] == 3
