"""The PSF bank: PSFs of a lens on the sensor's pixel grid, at any place in the field."""

import numpy as np

from .folding import mirror_symmetric

BATCH_SAMPLES = 1 << 20  # PSF samples in work at once: about 100 MB of temporaries


class PsfBank:
    """Pixel PSFs of one lens at one wavelength.

    Parameters
    ----------
    optics : MonochromaticLens
    pixel_pitch_um : float

    Notes
    -----
    `radius_px` is how far a PSF can reach from the pixel of its chief ray, whatever its direction.
    `mirror_symmetric` says whether its PSFs are symmetric about the meridional plane.
    """

    def __init__(self, optics, pixel_pitch_um):
        psf, self.mirror_symmetric = mirror_symmetric(optics.psf)
        window = psf.shape[-1]
        # A sample must not cover more than two pixels in a row: where pixels are small the table is refined.
        steps = int(np.ceil(2 * optics.psf_pitch_um / pixel_pitch_um - 1e-9))
        refined = _refine(psf, steps)
        self._sample_size_px = optics.psf_pitch_um / steps / pixel_pitch_um
        offset_px = (np.arange(refined.shape[-1]) - window // 2 * steps) * self._sample_size_px
        self._heights_mm = optics.heights_mm
        self._samples = refined.reshape(refined.shape[0], -1)
        self._v_px = np.repeat(offset_px, offset_px.size)
        self._u_px = np.tile(offset_px, offset_px.size)
        self.radius_px = psf_radius_px(optics, pixel_pitch_um)

    def psfs(self, paraxial_height_mm, azimuth_rad):
        """PSFs integrated over the pixels, for chief rays that meet pixel centres.

        Interpolated linearly in field height (section 2.2.3: PSFs, never OTFs), held beyond the last height,
        rotated to the azimuth, shared out among the pixels by area, and normalised (Eq. 9).

        Parameters
        ----------
        paraxial_height_mm, azimuth_rad : arrays (n,)
            Where in the field; the azimuth counts from +x (right) towards +y (up).

        Returns
        -------
        float64 array (n, row, column), odd square, unit sums, the chief ray in the middle, row 0 at the top
        """
        size = 2 * self.radius_px + 1
        result = np.empty((len(paraxial_height_mm), size, size))
        batch = max(1, BATCH_SAMPLES // self._v_px.size)
        for start in range(0, len(result), batch):
            part = slice(start, start + batch)
            energy = self._at_heights(np.asarray(paraxial_height_mm)[part])
            result[part] = self._share_out(energy, np.asarray(azimuth_rad)[part])
        result /= result.sum(axis=(1, 2), keepdims=True)
        return result

    def _at_heights(self, height_mm):
        position = np.interp(height_mm, self._heights_mm, np.arange(self._heights_mm.size))
        below = np.minimum(position.astype(int), self._heights_mm.size - 2)
        weight = (position - below)[:, None]
        return (1 - weight) * self._samples[below] + weight * self._samples[below + 1]

    def _share_out(self, energy, azimuth_rad):
        """Lay each sample, a small square of light, onto the pixels that it covers."""
        cos, sin = np.cos(azimuth_rad)[:, None], np.sin(azimuth_rad)[:, None]
        right = self._v_px * cos + self._u_px * sin  # v runs outwards, along (cos, sin); u along (sin, -cos)
        down = -self._v_px * sin + self._u_px * cos
        # Squares as wide as the turned samples are: at 0 and 45 degrees they then tile the plane without gaps.
        width = (np.abs(cos) + np.abs(sin)) * self._sample_size_px
        row, row_share = self._split(down, width)
        column, column_share = self._split(right, width)
        size = 2 * self.radius_px + 1
        first = (np.arange(len(energy))[:, None] * size + row) * size + column
        in_row, below_row = energy * row_share, energy * (1 - row_share)
        shares = ((first, in_row * column_share), (first + 1, in_row * (1 - column_share)),
                  (first + size, below_row * column_share), (first + size + 1, below_row * (1 - column_share)))
        pixels = np.zeros(len(energy) * size * size)
        for index, share in shares:
            pixels += np.bincount(index.ravel(), share.ravel(), minlength=pixels.size)
        return pixels.reshape(-1, size, size)

    def _split(self, offset_px, width_px):
        """First pixel that a square of `width_px` at this offset covers, and the share that lies in it."""
        start = offset_px - width_px / 2
        pixel = np.floor(start + 0.5)
        share = np.minimum((pixel + 0.5 - start) / width_px, 1)
        return pixel.astype(int) + self.radius_px, share


def psf_radius_px(lens, pixel_pitch_um):
    """Pixels that the PSF windows of a lens, turned any way, reach from the pixel of the chief ray.

    One pixel more than its half diagonal, since a sample is shared between a pixel and the next.
    """
    half_diagonal_um = np.hypot(1, 1) * (lens.psf.shape[-1] // 2 + 0.5) * lens.psf_pitch_um
    return int(np.ceil(half_diagonal_um / pixel_pitch_um)) + 1


def _refine(psf, steps):
    """PSFs with `steps` samples for each one of the table, by linear interpolation."""
    position = np.arange((psf.shape[-1] - 1) * steps + 1) / steps
    below = np.minimum(position.astype(int), max(psf.shape[-1] - 2, 0))
    above = np.minimum(below + 1, psf.shape[-1] - 1)
    weight = position - below
    psf = (1 - weight) * psf[..., below] + weight * psf[..., above]
    weight = weight[:, None]
    return (1 - weight) * psf[..., below, :] + weight * psf[..., above, :]
