"""Renders as farm tasks: every task receives the arguments of the command line, whatever characters they contain."""

import pytest
import yaml

from lensfield.cli import _parser, main
from lensfield.commands.sequence import frames_text, parse_frames
from lensfield.commands.task import frames_by_task, task_arguments

AWKWARD = "-ö 'q\" $x `y`;"


def parsed(*words):
    return _parser().parse_args(["render", *map(str, words)])


@pytest.fixture
def blend(tmp_path):
    path = tmp_path / f"{AWKWARD}.blend"
    path.write_bytes(b"")
    return path


@pytest.mark.parametrize("arguments", [
    [], ["--denoise", "on"], ["--no-focused-wide-open"], ["--overwrite", "--room", "0.1"], [f"--view-layer={AWKWARD}"],
    ["--focus", "1.2m", "--f-number", "4", "--focused-wide-open", "--lens", "tessar-50mm"],
    ["--iris-blades", "5", "--iris-rotation", "-30", "--wavelengths", "400:700:31", "--tier", "standard"],
    ["--method", "exact", "--precision", "float64", "--supersampling", "2", "--resolution", "64x48", "--samples", "1"]])
def test_options_reach_the_tasks(blend, arguments):
    options = parsed(blend, *arguments)
    assert parsed(blend, *task_arguments(options)) == options


def test_paths_reach_the_tasks_as_absolute_paths(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lens = tmp_path / "my lens.toml"
    lens.write_text("")
    assert task_arguments(parsed("scene.blend", "--lens", lens.name, "--output", "out")) == [
        f"--output={tmp_path / 'out'}", f"--lens={lens}"]


def test_frames_are_divided_among_tasks_in_order():
    options = parsed("scene.blend", "--frames=-2-3,7,9-10", "--frames-per-task", "4")
    tasks = frames_by_task(options)
    assert tasks == [[-2, -1, 0, 1], [2, 3, 7, 9], [10]]
    assert [parse_frames(frames_text(frames)) for frames in tasks] == tasks
    assert frames_text([1, 2, 3, 5, 7, 8]) == "1-3,5,7-8"


def write_job(blend, *more):
    return main(["farm", "openjd", str(blend), "--frames", "1-3", "--output", str(blend.parent / "out"), "--job",
                 str(blend.parent / "job"), *more])


def test_a_job_has_its_paths_as_parameters(blend):
    assert write_job(blend, "--lens", "tessar-50mm", f"--view-layer={AWKWARD}") == 0
    template = yaml.safe_load((blend.parent / "job" / "template.yaml").read_text(encoding="utf-8"))
    values = yaml.safe_load((blend.parent / "job" / "parameter_values.yaml").read_text(encoding="utf-8"))
    assert values == {"parameterValues": [{"name": "Scene", "value": str(blend)},
                                          {"name": "Output", "value": str(blend.parent / "out")}]}
    action = template["steps"][0]["script"]["actions"]["onRun"]
    assert action["command"] == "lensfield"
    assert action["args"] == ["render", "{{Param.Scene}}", "--frames={{Task.Param.Frame}}", "--wait",
                              "--progress=openjd", "--output={{Param.Output}}", f"--view-layer={AWKWARD}",
                              "--lens=tessar-50mm"]


@pytest.mark.parametrize("more, why", [
    (("--view-layer", "{{Param.Scene}}"), "cannot contain {{"), (("--frames", "scene"), "give frame numbers"),
    (("--report", "report.json"), "each frame has its own"), (("--frames-per-task", "0"), "expected 1 to")])
def test_an_impossible_job_is_an_error(blend, capsys, more, why):
    assert write_job(blend, *more) == 1
    assert why in capsys.readouterr().err
    assert not [*blend.parent.glob("job/*")]


def test_a_job_overwrites_only_files_of_lensfield(blend, capsys):
    assert write_job(blend) == write_job(blend) == 0
    template = blend.parent / "job" / "template.yaml"
    template.write_text("mine")
    assert write_job(blend) == 1
    assert "an existing file that Lensfield did not write" in capsys.readouterr().err and template.read_text() == "mine"


def test_a_job_never_overwrites_its_inputs(blend, capsys):
    (blend.parent / "job").mkdir()
    lens = blend.parent / "job" / "template.yaml"
    lens.write_text("mine")
    assert write_job(blend, "--lens", str(lens)) == 1
    assert "one of the inputs" in capsys.readouterr().err and lens.read_text() == "mine"
