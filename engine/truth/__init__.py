"""Ground truth: what the chief rays of a lens image's pixels meet."""
