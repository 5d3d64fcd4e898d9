"""A picture that grows in the viewport, what is drawn over it, and focus by a click on it."""
