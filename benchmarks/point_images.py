"""What a plan makes of single pixels' light: how many pixels it comes to, and how much of it in the wrong place."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lensfield.engine import Kept, Lens, SpectralImage
from lensfield.engine.channel import Channel
from lensfield.engine.field.distortion import FieldGeometry
from lensfield.engine.field.mirror_symmetry import Planes
from lensfield.engine.field.psf_bank import PlacedPsfs, PsfBank
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.plan.choose import workload
from lensfield.engine.plan.cost import counts
from lensfield.engine.plan.plan import Plan


@dataclass(frozen=True, eq=False)
class PointImages:
    """The images of single pixels on a grid, at one wavelength. Places are arrays (place, 2) of rows and columns."""

    lens: Lens
    wavelength_nm: float
    grid: PixelGrid
    channel: Channel
    radius_px: int

    def by_plan(self, places: np.ndarray) -> np.ndarray:
        """Images, array (place, row, column), of pixels none of which reaches into another's."""
        picture = np.zeros(self.grid.shape_px, np.float32)
        picture[tuple(places.T)] = 1
        blurred, side = self.channel.blur(self.channel.planes.split(picture)), 2 * self.radius_px + 1
        return np.stack([blurred[row:row + side, column:column + side] for row, column in places])

    def errors(self, places: np.ndarray) -> np.ndarray:
        """Which share of the light of each lands in the wrong place: the sum of |difference| from the exact image."""
        true = self._true_psfs.psfs(*places.T)
        rim = (true.shape[-1] - (2 * self.radius_px + 1)) // 2
        return np.abs(np.pad(self.by_plan(places), ((0, 0), (rim, rim), (rim, rim))) - true).sum(axis=(1, 2))

    def some_places(self, rng: np.random.Generator) -> np.ndarray:
        """Places as close together as may be, from a random one on."""
        spacing = 2 * self.radius_px + 1
        rows, columns = (np.arange(rng.integers(min(spacing, n)), n, spacing) for n in self.grid.shape_px)
        return np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)

    @cached_property
    def _true_psfs(self):
        optics = self.lens.at_wavelength(self.wavelength_nm)
        return PlacedPsfs(lambda: PsfBank.of(optics, self.grid.pitch_um), FieldGeometry(optics, self.lens.name),
                          Planes(self.grid, False))


def point_images(lens: Lens, radiance: SpectralImage, plan: Plan) -> list[PointImages]:
    """Those of a picture without overscan, at each of its wavelengths; as dim ones are spread, which have no halos."""
    channels = Kept(0).channels(lens, radiance, replace(plan, halo_energy=None, halo_radius_px=0))
    return [PointImages(lens, nm, radiance.grid, channel, plan.psf_radius_px)
            for channel, nm in zip(channels, radiance.wavelengths_nm, strict=True)]


def multiply_adds(lens: Lens, radiance: SpectralImage, plan: Plan) -> float:
    """Those without which a plan that spreads pixel by pixel is not done.

    One for each pixel and tap of its PSF that is not zero, and four to mix that tap from its neighbours in a table,
    which mirrored quadrants share; four for each pixel to resample it; and to turn the table's PSFs four for each of
    their samples, heights and azimuths.
    """
    rng, pixels, work = np.random.default_rng(0), np.prod(radiance.grid.shape_px), workload(plan, lens, radiance)
    taps = [np.count_nonzero(each.by_plan(places)) / len(places)
            for each in point_images(lens, radiance, plan) for places in [each.some_places(rng)]]
    turned = 4 * work.heights * counts(work, plan)["table sample"]
    return float(pixels * np.sum(np.multiply(taps, 1 + 4 / work.planes.count) + 4) + len(taps) * turned)
