"""Blender's scene: what is rendered of it, by which camera and settings, put back afterwards; and its compositor."""
