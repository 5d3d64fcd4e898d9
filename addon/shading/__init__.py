"""Spectral materials, lights and worlds: the linter judges them, substitution sets them up for the render."""
