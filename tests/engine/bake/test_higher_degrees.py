"""Wavefronts that the polynomial of a quality does not fit get one of a higher degree."""

from lensfield.engine.bake import psfs
from lensfield.engine.bake.diffraction import WORST_FIT_WAVES
from lensfield.engine.bake.pupil_fit import fit_pupils
from lensfield.engine.library import load_lens
from lensfield.engine.rays.rings import Rings


def test_a_fisheye_focused_near_is_baked_for_the_preview(monkeypatch):
    """Where degree 12 misses by 0.31 waves, and 0.3 are the limit."""
    missed = []

    def fitted(traced, degree, wavelengths_nm):
        fits = fit_pupils(traced, degree, wavelengths_nm)
        if fits[0].error_um > WORST_FIT_WAVES * wavelengths_nm.min() * 1e-3:
            missed.append(degree)
        return fits

    monkeypatch.setattr(psfs, "fit_pupils", fitted)
    monkeypatch.setenv("LENSFIELD_CACHE", "off")
    assert load_lens("olympus-fisheye-8mm", Rings(focus_mm=10e3, f_number=5.6), "preview").efl_mm > 0
    assert missed == [12]
