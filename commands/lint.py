"""`lensfield lint`: whether a .blend would be rendered, how, and what becomes of its settings and nodes."""

import json
from dataclasses import asdict

from .render import FRAME_LIMITS, add_scene_options, check_limits, scene_and_arguments
from .terminal import quiet


def add(commands):
    lint = commands.add_parser(
        "lint", help="what a render would make of a .blend; exit status 1 where it would be refused",
        description="Tell whether `lensfield render` with the same options would be refused (exit status 1), which "
                    "wavelengths it would render, and what becomes of the scene's settings and of each node's colours.")
    add_scene_options(lint)
    lint.add_argument("--frame", type=int, help="frame to look at (default: the scene's current one)")
    lint.add_argument("--json", action="store_true", help="as JSON")
    lint.set_defaults(run=_lint)


def _lint(options):
    """Tell what is found; the exit status that scripts go by: 1 where a render would be refused."""
    if options.frame is not None:
        check_limits("--frame", options.frame, FRAME_LIMITS)
    scene, asked = scene_and_arguments(options)
    from ..addon import preflight
    from ..addon.shading.lint import counts_text

    with quiet(1):  # Cycles says there which devices it misses, and a program reads JSON here
        found = preflight(scene, frame=options.frame, **asked)
    if options.json:
        print(json.dumps({
            "plan": found.plan.text if found.plan else None,
            "refusals": [{"where": each.where, "field": each.field, "value": str(each.value), "remedy": each.remedy}
                         for each in found.refusals],
            "remarks": [asdict(remark) for remark in found.remarks],
            "nodes": [asdict(finding) for finding in found.findings]}, indent=2))
        return int(bool(found.refusals))
    for finding in found.findings:
        print(finding)
    print(counts_text(found.findings))
    for remark in found.remarks:
        print(remark)
    if found.plan:
        print(f"scene: {found.plan.text}")
    for refusal in found.refusals:
        print(f"refused: {refusal}")
    return int(bool(found.refusals))
