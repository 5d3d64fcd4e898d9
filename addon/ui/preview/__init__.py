"""A picture that grows in the viewport, its overlays, and focus by a click on it."""
