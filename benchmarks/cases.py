"""The pictures, lenses and accuracies of the measurements, and their targets."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from lensfield.engine import Lens, Options, Rings, SpectralImage, load_lens
from lensfield.engine.field.field_map import field_map
from lensfield.engine.lens import GridLens, RadialLens
from lensfield.engine.spectral.spectra import blackbody

ROOT = Path(__file__).resolve().parents[1]
SCENE = ROOT / "sample_scenes" / "evening_chess.blend"
LENSES = ("angenieux-50mm", "apple-phone-4mm", "cooke-triplet-50mm", "edmund-54852", "kodak-petzval-100mm",
          "muller-fisheye-25mm", "nikkor-28mm", "tessar-50mm")  # a varied selection
PAPER_LENS = "edmund-54852"
NM = 587.6
SENSOR_UM = 4800  # the paper's 1/3 inch frame: 4.8 x 3.6 mm
PAPER = Options(method="paper")
HD, QUARTER_HD, UHD = (1080, 1920), (540, 960), (2160, 3840)
ALIKE = ("name", "maker", "story", "source", "notes", "efl_mm", "magnification", "f_number_effective",
         "object_distance_mm", "entrance_pupil_mm", "sensor_mm", "reference_wavelength_nm", "wavelengths_nm",
         "psf_pitch_um", "transmittance")
ON_GRID = " on a grid"
LEANING = 0.1  # of the light, removed at the upper edge of the field to make the halves differ



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


def lens_set_to(text: str) -> Lens:
    """The lens NAME[:F-NUMBER] of the library, at preview quality."""
    name, _, f_number = text.partition(":")
    return load_lens(name, Rings(f_number=float(f_number) if f_number else None), "preview")


def pixels(size: str) -> tuple[int, int]:
    """Width and height in a text such as 96x72."""
    width, height = map(int, size.split("x"))
    return width, height


def lens_of(name: str) -> Lens:
    """A lens of the library, or the same sampled on a grid of places: "NAME on a grid"."""
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
