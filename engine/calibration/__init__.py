"""Calibrations of lenses in the models and files of other programs, fitted to the rays of the lens's own field map."""
