"""Depth: layered radiance along the rays of a lens, slabs of depth, and hidden surfaces."""
