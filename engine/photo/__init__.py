"""Irradiance -> photograph: a camera's exposure of a lens image, and its raw file."""
