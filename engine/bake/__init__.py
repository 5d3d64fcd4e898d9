"""Baking: from what a lens is made of to its lens data, by rays and by diffraction. `bake.bake` does it."""
