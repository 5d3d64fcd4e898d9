"""`lensfield lint`: what becomes of every node that reaches a render of a .blend."""

import json
from dataclasses import asdict
from pathlib import Path

from .blend import open_scene


def add(commands):
    lint = commands.add_parser("lint", help="what becomes of each node's colours; exit status 1 where one is rejected")
    lint.add_argument("scene", type=Path, metavar="SCENE.blend")
    lint.add_argument("--json", action="store_true", help="as JSON")
    lint.set_defaults(run=_lint)


def _lint(options):
    """Tell the findings; the exit status that scripts go by: 1 where a node is rejected."""
    scene = open_scene(options.scene)
    from ..addon.shading.lint import counts_text, lint
    from ..addon.shading.node_rules import REJECTED

    findings = lint(scene)
    if options.json:
        print(json.dumps([asdict(finding) for finding in findings], indent=2))
    else:
        print(*findings, counts_text(findings), sep="\n")
    return int(any(finding.verdict == REJECTED for finding in findings))
