"""Depth: layered radiance, seen along the rays of a lens."""
