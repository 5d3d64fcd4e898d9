"""Spectral images on the sensor's pixel grid: their files, their pictures, and what an ideal lens makes of them."""
