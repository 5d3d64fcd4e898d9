"""How finely lens data are sampled, by a bake or by another program's macro, where nothing else is asked for."""

from ..spectral.spectra import parse_wavelengths

HEIGHTS = 21
WAVELENGTHS = "400:700:31"
WAVELENGTHS_NM = tuple(parse_wavelengths(WAVELENGTHS).tolist())
