"""Radiance -> files: renders of a frame, of an animation and of a preview, other lenses, and their processes."""
