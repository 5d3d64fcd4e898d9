"""The sensor: spectral irradiance becomes electrons, and these become a raw picture."""
