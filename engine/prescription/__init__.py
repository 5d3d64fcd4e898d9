"""Prescriptions: surfaces, glasses and first-order figures of a lens, and readers of their files."""
