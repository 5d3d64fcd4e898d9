"""Lenses of the library that differ as lenses do: what has to hold for all is tried on these."""

from functools import lru_cache

from lensfield.engine.library import load

VARIED = ("angenieux-50mm", "apple-phone-4mm", "cooke-triplet-50mm", "edmund-54852", "kodak-petzval-100mm",
          "muller-fisheye-25mm", "nikkor-28mm", "tessar-50mm")


@lru_cache
def varied_lens(name):
    """One of them as quickly as it can be baked."""
    return load(name, quality="preview")
