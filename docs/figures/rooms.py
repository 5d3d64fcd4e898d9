"""Generate the graph of the rooms in docs/architecture.md, from the table that tests/test_architecture.py enforces.

    python docs/figures/rooms.py docs/architecture.md

An arrow means "imports". Arrows that follow from others are omitted.
"""

import re
import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[2] / folder) for folder in ("tests", "tests/support")]

from test_architecture import FLOORS  # noqa: E402

GRAPH = re.compile(r"```mermaid\n.*?```", re.DOTALL)
NAMES = {"": "lensfield", "engine": "engine API"}


def reduced(arrows):
    """Remove the arrows {room: rooms} that follow from others (the transitive reduction)."""
    def below(room):
        return set(arrows[room]).union(*(below(other) for other in arrows[room]))

    return {room: others - set().union(*(below(other) for other in others)) for room, others in arrows.items()}


def graph():
    """The rooms and arrows as Mermaid text."""
    arrows = {room: {other for other in others if other != room and (room, other) != ("cli", "")}
              for room, others in FLOORS.items()}
    lines = [f"    {_box(room)} --> {_box(other)}"
             for room, others in reduced(arrows).items() for other in sorted(others)]
    return "\n".join(["```mermaid", "graph TD", *lines, "```"])


def _box(room):
    return f'{room.replace(".", "_") or "package"}["{NAMES.get(room, room.removeprefix("engine."))}"]'


def with_graph(text):
    """The page's text with an up-to-date graph."""
    return GRAPH.sub(lambda _: graph(), text)


if __name__ == "__main__":
    page = Path(sys.argv[1])
    page.write_text(with_graph(page.read_text(encoding="utf-8")), encoding="utf-8")
