"""Paths of folders that are not part of the package."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "tests" / "data"
SAMPLE_SCENE = ROOT / "sample_scenes" / "evening_chess.blend"
SHARED_DATA = ROOT.parent / "shared" / "data"
"""Real lens data that the project may not distribute. Tests that need it are skipped if it is missing."""
