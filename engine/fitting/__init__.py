"""Lenses as photographed: the light of even fields in photographs, and rims that are fitted to it."""
