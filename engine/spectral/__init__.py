"""Spectra, colours and refractive indices, and which wavelengths tell all others."""
