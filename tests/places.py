"""Where tests find what is no part of the package."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "tests" / "data"
SAMPLE_SCENE = ROOT / "sample_scenes" / "evening_chess.blend"
SHARED_DATA = ROOT.parent / "shared" / "data"
"""Real lens data that are not the project's to give: tests that use them are skipped where they are not at hand."""
