"""An overlap-add with hat windows in a few lines of numpy, for comparison with the engine.

Sections overlap by half under windows that sum to 1, and each is convolved with the PSF at its middle.
"""

import numpy as np
import scipy

from lensfield.engine import Lens
from lensfield.engine.field.mirror_symmetry import Planes
from lensfield.engine.field.radial.distortion import FieldGeometry
from lensfield.engine.field.radial.psf_bank import PlacedPsfs, PsfBank
from lensfield.engine.image.pixel_grid import PixelGrid

SECTION_PX = 44  # between the middles of sections: the paper's frame has an error (L2) of 0.011


def given_psfs(lens: Lens, wavelength_nm: float, grid: PixelGrid, energy: float) -> np.ndarray:
    """PSFs at the middles of the sections: float32 array (section row, section column, row, column)."""
    optics = lens.at_wavelength(wavelength_nm)
    bank = PsfBank.of(optics, grid.pitch_um).trimmed(energy)
    places = np.meshgrid(*(_middles(n) for n in grid.shape_px), indexing="ij")
    placed = PlacedPsfs(lambda: bank, FieldGeometry(optics, lens.name), Planes(grid, False))
    psfs = placed.psfs(*(each.ravel() for each in places))
    return psfs.reshape(*places[0].shape, *psfs.shape[1:]).astype(np.float32)


def overlap_add(picture: np.ndarray, psfs: np.ndarray) -> np.ndarray:
    """Blur a picture, (row, column), with the PSFs of its sections."""
    radius, window = psfs.shape[-1] // 2, 2 * SECTION_PX - 1
    side, margin = scipy.fft.next_fast_len(window + 2 * radius, real=True), SECTION_PX - 1
    hat = (1 - np.abs(np.arange(-margin, SECTION_PX)) / SECTION_PX).astype(picture.dtype)
    framed = np.pad(picture, (margin, 2 * SECTION_PX))
    result = np.zeros([n + side for n in framed.shape], picture.dtype)
    for psfs_of_row, top in zip(psfs, _middles(picture.shape[0]), strict=True):
        for psf, left in zip(psfs_of_row, _middles(picture.shape[1]), strict=True):
            section = framed[top:top + window, left:left + window] * hat[:, None] * hat
            spectrum = scipy.fft.rfft2(section, (side, side)) * scipy.fft.rfft2(psf, (side, side))
            result[top:top + side, left:left + side] += scipy.fft.irfft2(spectrum, (side, side))
    rows, columns = (slice(margin + radius, margin + radius + n) for n in picture.shape)
    return result[rows, columns]


def _middles(length_px):
    return np.arange(-(-length_px // SECTION_PX) + 1) * SECTION_PX
