"""Spectral images on the sensor's pixel grid, flat and in layers; Eq. 2."""
