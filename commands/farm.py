"""`lensfield farm`: write a render as a job for render farms."""

from pathlib import Path

import yaml

from lensfield.engine import InputError
from lensfield.engine.runtime.build_identity import MARK
from lensfield.engine.runtime.errors import shown
from lensfield.engine.runtime.files import atomic_path

from .arguments import check_outputs
from .render_options import add_farm_options, add_task_options
from .sequence import frames_text
from .task import frames_by_task, resolved_anywhere, scene_path, task_arguments
from .terminal import say

LONGEST_NAME = 100  # Open Job Description allows 128
OPENS = "{{"  # starts a reference in Open Job Description, which cannot escape it
PATHS = {"scene": ("Scene", "FILE", "IN"), "lens": ("Lens", "FILE", "IN"), "output": ("Output", "DIRECTORY", "OUT")}
"""Paths of a job: the parameter, its kind, and whether farms that copy files upload (IN) or download (OUT) it."""


def add_options(farm):
    farm.description = ("Write a render as a job for render farms. Each task runs `lensfield render` on a few frames, "
                        "and can be stopped and restarted.")
    kinds = farm.add_subparsers(required=True, metavar="KIND")
    openjd = kinds.add_parser("openjd", help="an Open Job Description job, as for AWS Deadline Cloud",
                              description="Write an Open Job Description job, as for AWS Deadline Cloud: a folder "
                                          "with template.yaml, and parameter_values.yaml for this .blend.")
    add_task_options(openjd)
    add_farm_options(openjd)
    openjd.add_argument("--job", type=Path, required=True, metavar="DIR", help="folder to write the job to")
    openjd.set_defaults(run=_write_openjd)


def _write_openjd(options):
    if options.output is None:
        raise InputError("options", "--output", "not given", "give the folder for the pictures")
    if options.report:
        raise InputError("options", "--report", str(options.report), "leave it out: each frame has its own report")
    template, values = options.job / "template.yaml", options.job / "parameter_values.yaml"
    check_outputs([(template, ".yaml"), (values, ".yaml")], [options.scene, *filter(None, [options.lens])])
    paths = {"scene": scene_path(options)} | {
        name: str(path) for name in ("lens", "output")
        if (path := getattr(options, name)) and (path := resolved_anywhere(path)) and Path(path).is_absolute()}
    _write(template, _template(options, paths))
    _write(values, {"parameterValues": [{"name": PATHS[name][0], "value": path} for name, path in paths.items()]})
    say(template, values)


def _template(options, paths):
    """The job in Open Job Description: https://github.com/OpenJobDescription/openjd-specifications"""
    frames = frames_text([frame for task in frames_by_task(options) for frame in task])
    task = {"name": "Frame", "type": "INT", "range": frames}
    if options.frames_per_task > 1:
        task |= {"type": "CHUNK[INT]", "chunks": {"defaultTaskCount": options.frames_per_task,
                                                  "rangeConstraint": "NONCONTIGUOUS"}}
    arguments = [_literal(each) for each in task_arguments(options, paths)]
    given = [f"--{name}={{{{Param.{PATHS[name][0]}}}}}" for name in paths if name != "scene"]
    command = ["{{Param.Blender}}", "--background", "--command", "lensfield"] if options.blender else ["lensfield"]
    parameters = [{"name": PATHS[name][0], "type": "PATH", "objectType": PATHS[name][1],
                   "dataFlow": PATHS[name][2]} for name in paths]
    if options.blender:
        parameters.append({"name": "Blender", "type": "STRING", "default": options.blender})
    return {
        "specificationVersion": "jobtemplate-2023-09",
        **({"extensions": ["TASK_CHUNKING"]} if options.frames_per_task > 1 else {}),
        "name": _literal(f"Lensfield {shown(options.scene.stem, LONGEST_NAME)}"),
        "parameterDefinitions": parameters,
        "steps": [{
            "name": "Render",
            "parameterSpace": {"taskParameterDefinitions": [task]},
            "script": {"actions": {"onRun": {
                "command": command[0],
                "args": [*command[1:], "render", "{{Param.Scene}}", "--frames={{Task.Param.Frame}}", "--wait",
                         "--progress=openjd", *given, *arguments],
                "cancelation": {"mode": "NOTIFY_THEN_TERMINATE"}}}}}]}


def _literal(text):
    """The text unchanged; raises an InputError if Open Job Description would expand a reference in it."""
    if OPENS in text:
        raise InputError("options", "text", text, f"Open Job Description cannot contain {OPENS}")
    return text


def _write(path, facts):
    with atomic_path(path) as temporary:
        text = yaml.safe_dump(facts, sort_keys=False, allow_unicode=True, width=1000)
        temporary.write_text(f"# {MARK}\n{text}", encoding="utf-8")
