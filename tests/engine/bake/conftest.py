"""Baking needs the environment of `make bake`; without it these tests say so and are skipped."""

import pytest

pytest.importorskip("optiland", reason="baking needs lensfield[bake]: make bake")
