"""An anamorphic attachment."""

from lensfield.engine.prescription.prescription import Surface

SQUEEZE = 2.0
AFOCAL = (Surface(thickness_mm=1.0, glass="1.5/60", semi_aperture_mm=40.0),
          Surface(radius_x_mm=0.5 * 80, thickness_mm=(SQUEEZE - 1) * 80, semi_aperture_mm=40.0),
          Surface(radius_x_mm=0.5 * 80 * SQUEEZE, thickness_mm=2.0, glass="1.5/60", semi_aperture_mm=40.0),
          Surface(thickness_mm=2.0, semi_aperture_mm=40.0))
"""Thin cylinders of the focal lengths -80 mm and 160 mm, which halve angles along x."""
