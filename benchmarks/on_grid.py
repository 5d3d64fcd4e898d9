"""Rotationally symmetric lenses sampled on a grid of places, as lenses without rotational symmetry are."""

import numpy as np
import scipy

from lensfield.engine import Lens, load_lens
from lensfield.engine.field.field_map import field_map
from lensfield.engine.lens import GridLens, RadialLens

ALIKE = ("name", "maker", "story", "source", "notes", "efl_mm", "magnification", "f_number_effective",
         "object_distance_mm", "entrance_pupil_mm", "sensor_mm", "reference_wavelength_nm", "wavelengths_nm",
         "psf_pitch_um", "transmittance")
ON_GRID = " on a grid"
LEANING = 0.1  # of the light, removed at the upper edge of the field to make the halves differ


def lens_of(name: str) -> Lens:
    """A lens of the library, or the same on a grid: "NAME on a grid"."""
    return on_grid(load_lens(name.removesuffix(ON_GRID))) if name.endswith(ON_GRID) else load_lens(name)


def on_grid(lens: RadialLens, rows: int = 13, columns: int = 19, mirrored: tuple[bool, bool] = (False, False)
            ) -> GridLens:
    """The lens on a grid over its sensor, without prescription; with less light above than below unless mirrored."""
    y_mm, x_mm = (np.linspace(0 if mirror else -side_mm / 2, side_mm / 2, (n + 1) // 2 if mirror else n)
                  for n, mirror, side_mm in zip((rows, columns), mirrored, lens.sensor_mm[::-1], strict=True))
    x, y = np.meshgrid(x_mm, y_mm)
    fields = [field_map(lens).at_wavelength(nm) for nm in lens.wavelengths_nm]
    heights_mm = [np.hypot(*field.source_mm(x, y)) for field in fields]
    tables = {name: np.array([np.interp(at_mm, lens.heights_mm, table) for at_mm, table in
                              zip(heights_mm, getattr(lens, name), strict=True)])
              for name in ("relative_illumination", "point_flux", "enclosed_energy")}
    if not mirrored[0]:
        tables["relative_illumination"] *= 1 - LEANING * (1 + y / y_mm[-1]) / 2
    last_mm = float(lens.real_height_at(lens.reference_wavelength_nm)[-1])
    return GridLens(**{name: getattr(lens, name) for name in ALIKE}, y_mm=y_mm, x_mm=x_mm, mirrored=mirrored,
                    source_mm=np.array([np.stack(field.source_mm(x, y), axis=-1) for field in fields]),
                    within=np.hypot(x, y) / last_mm, **tables,
                    psf=np.array([_turned(psf, lens.heights_mm, at_mm, np.arctan2(y, x))
                                  for psf, at_mm in zip(lens.psf, heights_mm, strict=True)]))


def _turned(psf, heights_mm, at_mm, azimuth_rad):
    """PSFs (height, v, u) at places, turned so that v points upwards: array (row, column, v, u)."""
    middle, position = psf.shape[-1] // 2, np.interp(at_mm, heights_mm, np.arange(heights_mm.size))
    up, right = np.indices(psf.shape[1:]) - middle
    result = np.empty((*at_mm.shape, *psf.shape[1:]), np.float32)
    for place in np.ndindex(at_mm.shape):
        below = min(int(position[place]), heights_mm.size - 2)
        on = position[place] - below
        cosine, sine = np.cos(azimuth_rad[place]), np.sin(azimuth_rad[place])
        outwards, along = right * cosine + up * sine, right * sine - up * cosine
        turned = scipy.ndimage.map_coordinates((1 - on) * psf[below] + on * psf[below + 1],
                                               [outwards + middle, along + middle], order=1)
        result[place] = turned / turned.sum()
    return result
