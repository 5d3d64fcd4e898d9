"""Sources of stray light: bright places in front of a lens, in the picture or beyond its edges."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ..runtime.errors import ImageError


@dataclass(frozen=True, eq=False)
class Sources:
    """Small sources of light in front of a lens, such as lamps, or the parts of a window.

    Attributes
    ----------
    directions : array (source, 3)
        Unit vectors from the middle of the entrance pupil to each source: to the right and up, as in the upright
        picture, and along the camera's axis towards the scene; negative behind the camera.
    distance_mm : array (source,)
        From the middle of the entrance pupil; inf for sources at infinity.
    irradiance : array (source, wavelength)
        W m^-2 nm^-1 at the middle of the entrance pupil, on a plane perpendicular to the direction.
    wavelengths_nm : array (wavelength,)
    radius_rad : array (source,)
        Angular radius of a disc with the same solid angle; 0 for a point.
    names : tuple of str
        For reports, such as "Sun" or "picture at 812, 340 px".

    Raises
    ------
    ImageError
        Values that are not finite, light below zero, or parts that do not match.
    """

    directions: np.ndarray
    distance_mm: np.ndarray
    irradiance: np.ndarray
    wavelengths_nm: np.ndarray
    radius_rad: np.ndarray
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        count, waves = len(self.names), len(self.wavelengths_nm)
        shapes = {"directions": (count, 3), "distance_mm": (count,), "irradiance": (count, waves),
                  "radius_rad": (count,)}
        for name, shape in shapes.items():
            values = getattr(self, name)
            if np.shape(values) != shape:
                raise ImageError("sources", name, f"of shape {np.shape(values)}", f"expected {shape}")
            if np.isnan(values).any() or (name != "distance_mm" and not np.isfinite(values).all()):
                raise ImageError("sources", name, "with values that are not finite", "expected numbers")
        if not (np.all(self.irradiance >= 0) and np.all(self.radius_rad >= 0) and np.all(self.distance_mm > 0)):
            raise ImageError("sources", "irradiance, radius_rad or distance_mm", "below zero", "expected zero or more")

    def __len__(self) -> int:
        return len(self.names)

    def chosen(self, indices: np.ndarray) -> Self:
        """Some of the sources."""
        return replace(self, directions=self.directions[indices], distance_mm=self.distance_mm[indices],
                       irradiance=self.irradiance[indices], radius_rad=self.radius_rad[indices],
                       names=tuple(self.names[index] for index in indices))

    @classmethod
    def together(cls, parts: Sequence[Self]) -> Self:
        """The sources of one or more parts; an ImageError if their wavelengths differ."""
        nm = parts[0].wavelengths_nm
        for part in parts:
            if not np.array_equal(part.wavelengths_nm, nm):
                raise ImageError("sources", "wavelengths_nm", part.wavelengths_nm.tolist(), f"expected {nm.tolist()}")

        def joined(name):
            return np.concatenate([getattr(part, name) for part in parts])

        return cls(joined("directions"), joined("distance_mm"), joined("irradiance"), nm,
                   joined("radius_rad"), tuple(name for part in parts for name in part.names))


def widths_nm(wavelengths_nm: np.ndarray) -> np.ndarray:
    """The interval that each wavelength represents; 1 for a single one."""
    return np.gradient(wavelengths_nm) if len(wavelengths_nm) > 1 else np.ones(1)
