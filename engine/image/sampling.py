"""Sampling: the pixels and wavelengths of a picture, without its light."""

from dataclasses import dataclass, replace

from .pixel_grid import PixelGrid


@dataclass(frozen=True)
class Sampling:
    """The pixels and wavelengths of a picture: all that a plan and its channels depend on, apart from the lens.

    Attributes
    ----------
    grid : PixelGrid
    wavelengths_nm : tuple of float
        Ascending.
    """

    grid: PixelGrid
    wavelengths_nm: tuple[float, ...]

    def finer(self, times: int) -> "Sampling":
        """The same area and wavelengths, with each pixel split into `times` x `times`."""
        return replace(self, grid=self.grid.finer(times))
