"""Spectra, colours and refractive indices, and the choice of wavelengths to render."""
