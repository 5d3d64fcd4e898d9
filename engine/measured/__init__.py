"""Lenses as measured: the calibrations, STMaps and profiles of other programs, as `Lens`."""
