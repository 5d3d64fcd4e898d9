"""The pictures, lenses and accuracies of the engine's benchmarks, and their targets."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lensfield.engine import Lens, Options, SpectralImage
from lensfield.engine.spectral.spectra import blackbody

LENSES = ("angenieux-50mm", "apple-phone-4mm", "cooke-triplet-50mm", "edmund-54852", "kodak-petzval-100mm",
          "muller-fisheye-25mm", "nikkor-28mm", "tessar-50mm")  # a varied selection
PAPER_LENS = "edmund-54852"
NM = 587.6
SENSOR_UM = 4800  # the paper's 1/3 inch frame: 4.8 x 3.6 mm
PAPER = Options(method="paper")
HD, QUARTER_HD, UHD = (1080, 1920), (540, 960), (2160, 3840)


def checkerboard(rows: int = 576, columns: int = 768, square_px: int = 24) -> SpectralImage:
    """The paper's target, at one wavelength."""
    return SpectralImage(_squares(rows, columns, square_px), [NM], pitch_um=SENSOR_UM / columns)


def points(rows: int = 576, columns: int = 768, spacing_px: int = 37) -> SpectralImage:
    """Single lit pixels: the most demanding picture."""
    plane = np.zeros((rows, columns))
    plane[spacing_px // 2::spacing_px, spacing_px // 2::spacing_px] = 1
    return SpectralImage(plane, [NM], pitch_um=SENSOR_UM / columns)


def multispectral(rows: int = 253, columns: int = 380) -> SpectralImage:
    """The paper's other size: 31 wavelengths of tungsten light on a coarse checkerboard with points."""
    nm = np.linspace(400, 700, 31)
    pattern = 0.1 + 0.9 * _squares(rows, columns, 12)
    pattern[::31, ::31] += 5
    return SpectralImage(blackbody(2856).at(nm)[:, None, None] * pattern, nm, pitch_um=SENSOR_UM / columns)


def night_street(lens: Lens, shape_px: tuple[int, int], nm: np.ndarray) -> SpectralImage:
    """Noisy squares and lamps of one pixel, over the width of a lens's sensor, without black or uniform parts."""
    rng = np.random.default_rng(1)
    plane = (0.2 + 0.8 * _squares(*shape_px, 24)) * (0.9 + 0.2 * rng.random(shape_px))
    plane[::61, ::61] += 20
    cube = np.empty((len(nm), *shape_px), np.float32)
    for band, light in zip(cube, np.linspace(0.5, 1, len(nm)), strict=True):
        np.multiply(plane, light, out=band, casting="same_kind")
    return SpectralImage(cube, nm, pitch_um=1e3 * lens.sensor_mm[0] / shape_px[1])


def _squares(rows, columns, size_px):
    row, column = np.mgrid[:rows, :columns]
    return (row // size_px + column // size_px) % 2


@dataclass(frozen=True)
class Case:
    """A picture to filter, with its targets.

    Attributes
    ----------
    name : str
    lens : str
    wavelengths : int
    radiance : callable (Lens) -> SpectralImage
    accuracy : float
    target_s : float or None
        Target in processor seconds, if any.
    best_of : int
        Number of runs; the fastest counts.
    part : int or None
        Number of wavelengths to extrapolate slow methods from; None to measure all wavelengths.
    in_place : bool
        Whether the irradiance overwrites the radiance.
    """

    name: str
    lens: str
    wavelengths: int
    radiance: Callable[[Lens], SpectralImage]
    accuracy: float
    target_s: float | None
    best_of: int = 3
    part: int | None = None
    in_place: bool = False


def _street(shape_px, wavelengths, accuracy, lens, target_s, **how):
    """A case of `night_street`."""
    nm = np.linspace(420, 680, wavelengths) if wavelengths > 1 else np.array([NM])
    rows, columns = shape_px
    return Case(f"{columns}x{rows} x {wavelengths}, {accuracy:g}, {lens}", lens, wavelengths,
                lambda lens: night_street(lens, shape_px, nm), accuracy, target_s, **how)


BOARDS = tuple(Case(f"768x576, {accuracy:g}", PAPER_LENS, 1, lambda lens: checkerboard(), accuracy, target_s, best_of=5)
               for accuracy, target_s in ((0.1, 0.06), (0.01, 0.10), (0.001, 0.2)))
OTHERS = (
    Case("380x253 x 31, 0.01", PAPER_LENS, 31, lambda lens: multispectral(), 0.01, 0.6),
    *(_street(QUARTER_HD, 3, 0.1, lens, 0.15, best_of=5) for lens in (PAPER_LENS, "nikkor-28mm")),
    *(_street(QUARTER_HD, 9, 0.05, lens, 0.4) for lens in (PAPER_LENS, "nikkor-28mm")),
    *(_street(HD, 1, 0.01, lens, None)
      for lens in ("angenieux-50mm", "kodak-petzval-100mm", "nikkor-28mm", "muller-fisheye-25mm")),
    *(_street(HD, 12, 0.01, lens, 4.5, best_of=2, part=3) for lens in (PAPER_LENS, "nikkor-28mm")),
    _street(UHD, 31, 0.01, PAPER_LENS, 120, best_of=1, part=1, in_place=True))  # a minute on two cores
CASES = {case.name: case for case in BOARDS + OTHERS}
