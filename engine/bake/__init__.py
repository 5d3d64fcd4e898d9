"""Baking: from what a lens is made of to its lens data, through Optiland's rays. `bake.bake` does it.

It needs the optional extra `lensfield[bake]`, all but `prescription`; nothing else of the engine does.
"""
