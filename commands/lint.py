"""`lensfield lint`: check whether and how a .blend would be rendered, with findings on its settings and nodes."""

import json
from dataclasses import asdict

from .arguments import check_limits
from .render import scene_and_fields
from .render_options import FRAME_LIMITS, add_scene_options
from .terminal import quiet, say


def add_options(lint):
    lint.description = (
        "Report whether `lensfield render` with the same options would be refused (exit status 1), which wavelengths "
        "it would render, and how it handles the scene's settings and each node's colours.")
    add_scene_options(lint)
    lint.add_argument("--frame", type=int, help="frame to check (default: the scene's current frame)")
    lint.add_argument("--json", action="store_true", help="print JSON")
    lint.set_defaults(run=_lint, confines=_folders)


def _folders(options):
    """The scene, without an output folder."""
    return options.scene, None


def _lint(options):
    """Report the findings; the exit status is 1 if a render would be refused."""
    if options.frame is not None:
        check_limits("--frame", options.frame, FRAME_LIMITS)
    scene, given = scene_and_fields(options)
    from ..addon import folder_for, preflight
    from ..addon.shading.lint import counts_text

    with quiet(1):  # Cycles lists missing devices on standard output, which must contain only JSON
        result = preflight(scene, frame=options.frame, **given)
    if options.json:
        print(json.dumps({
            "plan": result.plan.text if result.plan else None,
            "refusals": [{"where": each.where, "field": each.field, "value": str(each.value), "remedy": each.remedy}
                         for each in result.refusals],
            "remarks": [asdict(remark) for remark in result.remarks],
            "nodes": [asdict(finding) for finding in result.findings]}, indent=2))
        return int(bool(result.refusals))
    for finding in result.findings:
        say(finding)
    say(counts_text(result.findings))
    for remark in result.remarks:
        say(remark)
    if result.plan:
        say(f"scene: {result.plan.text}")
    if not result.refusals:
        say(f"output: {folder_for(scene, given.get('output_folder'))}")
    for refusal in result.refusals:
        say(f"refused: {refusal}")
    return int(bool(result.refusals))
