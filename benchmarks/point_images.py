"""The images of single pixels under a plan, and how much of their light is misplaced."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lensfield.engine import ChannelCache, Lens, SpectralImage
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.mirror_symmetry import Planes
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.plan.plan import Plan
from lensfield.engine.simulation.channel import Channel


@dataclass(frozen=True, eq=False)
class PointImages:
    """The images of single pixels of a grid, at one wavelength. Places are arrays (place, 2): row and column."""

    lens: Lens
    wavelength_nm: float
    grid: PixelGrid
    channel: Channel
    radius_px: int

    def by_plan(self, places: np.ndarray) -> np.ndarray:
        """Images of pixels under the plan: array (place, row, column). The images must not overlap."""
        picture = np.zeros(self.grid.shape_px, np.float32)
        picture[tuple(places.T)] = 1
        blurred, side = self.channel.blur(self.channel.planes.split(picture)), 2 * self.radius_px + 1
        return np.stack([blurred[row:row + side, column:column + side] for row, column in places])

    def errors(self, places: np.ndarray) -> np.ndarray:
        """Misplaced fraction of each pixel's light: the sum of |difference| from the exact image."""
        true = self._true_psfs.psfs(*places.T)
        rim = (true.shape[-1] - (2 * self.radius_px + 1)) // 2
        return np.abs(np.pad(self.by_plan(places), ((0, 0), (rim, rim), (rim, rim))) - true).sum(axis=(1, 2))

    def some_places(self, rng: np.random.Generator) -> np.ndarray:
        """A grid of places as dense as images allow without overlap, from a random start."""
        spacing = 2 * self.radius_px + 1
        rows, columns = (np.arange(rng.integers(min(spacing, n)), n, spacing) for n in self.grid.shape_px)
        return np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)

    @cached_property
    def _true_psfs(self):
        return field_map(self.lens).at_wavelength(self.wavelength_nm).psfs(lambda psfs: psfs, Planes(self.grid, False))


def point_images(lens: Lens, radiance: SpectralImage, plan: Plan) -> list[PointImages]:
    """Point images for a picture without overscan, at each wavelength. Pixels count as dim and get no halos."""
    channels = ChannelCache(0).channels(lens, radiance.sampling, replace(plan, halo_energy=None, halo_radius_px=0))
    return [PointImages(lens, nm, radiance.grid, channel, plan.psf_radius_px)
            for channel, nm in zip(channels, radiance.wavelengths_nm, strict=True)]
