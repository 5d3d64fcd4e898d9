"""Bundled lenses for tests: eight of different kinds, and all by their symmetry."""

from dataclasses import replace
from functools import lru_cache

from lenses import tinted
from lensfield.engine.bake.bake import bake
from lensfield.engine.library import bundled_names, find_bundled, load_lens, prescription_of
from lensfield.engine.rays.rings import turned

VARIED = ("angenieux-50mm", "apple-phone-4mm", "cooke-triplet-50mm", "edmund-54852", "kodak-petzval-100mm",
          "muller-fisheye-25mm", "nikkor-28mm", "tessar-50mm")
ANAMORPHIC = tuple(find_bundled(["anamorphic"]))
RADIAL = tuple(name for name in bundled_names() if name not in ANAMORPHIC)


@lru_cache
def varied_lens(name):
    """One of these lenses, baked as quickly as possible, of glass that absorbs some of the light (`tinted`)."""
    return tinted(load_lens(name, quality="preview"))


@lru_cache
def lens_for_rays(name, rings):
    """A turned lens for tests of its rays: with few field heights and wavelengths, and coarse PSFs."""
    prescription = turned(prescription_of(name), rings).prescription
    lens = bake(prescription, quality="preview", heights=5, wavelengths_nm=(500, 550, 600), samples=17, pitch_um=4.0)
    return replace(lens, prescription=prescription)
