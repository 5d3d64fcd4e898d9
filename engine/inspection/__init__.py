"""Inspection of a lens: checks of its data, curves, sheets."""
