"""Baking: from a prescription to lens data, by ray tracing and diffraction. Start at `bake.bake`."""
