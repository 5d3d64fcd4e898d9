"""Small lenses and images whose behaviour can be worked out by hand."""

from dataclasses import replace
from functools import partial

import numpy as np

from lensfield.engine import Options, SpectralImage, simulate
from lensfield.engine.field.radial.distortion import FieldGeometry
from lensfield.engine.field.radial.psf_bank import PsfBank
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens import GridLens, RadialLens

PIXEL_BY_PIXEL = Options(method="paper", section_size=1)
SENSOR_POINT, POINT_UM = ((1.0,),), 1e-6  # a PSF of one sample that is much smaller than a pixel: no blur
HEIGHTS_MM = np.linspace(0, 2, 11)


def make_lens(psf=SENSOR_POINT, real_height_mm=None, relative_illumination=None, *, psf_pitch_um=None,
              wavelengths_nm=(400.0, 700.0), heights_mm=HEIGHTS_MM, transmittance=1.0, **changes):
    """A lens without blur, distortion or shading, except for the given properties.

    `psf` is one PSF (v, u) for the complete field, or a table; `real_height_mm` and `relative_illumination` are
    functions of (wavelength_nm, paraxial_height_mm).
    """
    nm, height = np.meshgrid(wavelengths_nm, heights_mm, indexing="ij")
    psf_pitch_um = psf_pitch_um or (POINT_UM if psf is SENSOR_POINT else 2.5)
    psf = np.asarray(psf, dtype=float)
    facts = dict(
        name="hand-made", efl_mm=10.0, magnification=-0.1, f_number_effective=2.0, object_distance_mm=100.0,
        entrance_pupil_mm=5.0, sensor_mm=(4.8, 3.6), reference_wavelength_nm=550.0, wavelengths_nm=wavelengths_nm,
        heights_mm=heights_mm, real_height_mm=real_height_mm(nm, height) if real_height_mm else height,
        relative_illumination=relative_illumination(nm, height) if relative_illumination else np.ones_like(height),
        psf=np.broadcast_to(psf, nm.shape + psf.shape[-2:]), psf_pitch_um=psf_pitch_um,
        enclosed_energy=np.ones_like(height), transmittance=np.broadcast_to(transmittance, nm.shape[:1]))
    return RadialLens(**facts | changes)


def tinted(lens):
    """A lens whose glass transmits 45 % at the shortest wavelength and 85 % at the longest.

    With a transmittance of 1, no test could detect that it is omitted or applied twice.
    """
    share = np.interp(lens.wavelengths_nm, (lens.wavelengths_nm[0], lens.wavelengths_nm[-1]), (0.45, 0.85))
    return replace(lens, transmittance=lens.transmittance * share)


def marked_psf(v, u, window=25):
    """A PSF with all light in one sample, `v` samples outwards and `u` along the tangent from the chief ray."""
    psf = np.zeros((window, window))
    psf[window // 2 + v, window // 2 + u] = 1
    return psf


def gaussian_psf(sigma_v_um, sigma_u_um, pitch_um, window):
    """A Gaussian centred on the chief ray."""
    offset_um = (np.arange(window) - window // 2) * pitch_um
    psf = np.exp(-offset_um[:, None]**2 / (2 * sigma_v_um**2) - offset_um**2 / (2 * sigma_u_um**2))
    return psf / psf.sum()


def comatic_lens(heights=6, **changes):
    """Width, coma and distortion grow with the field, which exposes PSFs turned and quadrants flipped the wrong way."""
    table = np.stack([0.5 * gaussian_psf(4, 2 + h, 2.5, 17) + 0.5 * np.roll(gaussian_psf(2, 2, 2.5, 17), h, axis=0)
                      for h in range(heights)])
    return make_lens(np.stack([table, table]), lambda nm, p: p * (1 - 0.02 * p), heights_mm=np.linspace(0, 2, heights),
                     **changes)


def lopsided_lens():
    """A PSF with light off the meridional plane, increasingly with the field: the quadrants differ."""
    table = np.stack([0.6 * gaussian_psf(3, 2, 2.5, 17) + 0.4 * np.roll(gaussian_psf(2, 2, 2.5, 17), (h, 5 - h), (0, 1))
                      for h in range(4)])
    return make_lens(np.stack([table, table]), heights_mm=np.linspace(0, 2, 4))


def make_grid_lens(psf=SENSOR_POINT, source_mm=lambda nm, x, y: (x, y), relative_illumination=None, *, rows=5,
                   columns=7, half_mm=(1.5, 2.0), mirrored=(False, False), psf_pitch_um=None,
                   wavelengths_nm=(400.0, 700.0), within=lambda x, y: np.hypot(x / 2, y / 1.5) / 1.5,
                   transmittance=1.0, **changes):
    """As `make_lens`, over x and y: `psf` is one PSF, or a function of (x, y) in mm, like the other functions."""
    y_mm, x_mm = (np.linspace(0 if mirror else -half, half, (n + 1) // 2 if mirror else n)
                  for n, half, mirror in zip((rows, columns), half_mm, mirrored, strict=True))
    y, x = np.meshgrid(y_mm, x_mm, indexing="ij")
    nm = np.asarray(wavelengths_nm)[:, None, None]
    ones = np.ones((nm.size, *x.shape))
    psfs = np.array([[psf(*at) for at in zip(*row, strict=True)] for row in zip(x, y, strict=True)]
                    if callable(psf) else psf, dtype=float)
    facts = dict(
        name="hand-made grid", efl_mm=10.0, magnification=-0.1, f_number_effective=2.0, object_distance_mm=100.0,
        entrance_pupil_mm=5.0, sensor_mm=(4.0, 3.0), reference_wavelength_nm=550.0, wavelengths_nm=wavelengths_nm,
        y_mm=y_mm, x_mm=x_mm, mirrored=mirrored, within=within(x, y),
        source_mm=np.stack([ones * each for each in source_mm(nm, x, y)], axis=-1),
        relative_illumination=ones * (relative_illumination(nm, x, y) if relative_illumination else 1),
        psf=np.broadcast_to(psfs, ones.shape + psfs.shape[-2:]), enclosed_energy=ones,
        psf_pitch_um=psf_pitch_um or (POINT_UM if psf is SENSOR_POINT else 2.5),
        transmittance=np.broadcast_to(transmittance, nm.shape[:1]))
    return GridLens(**facts | changes)


fine_grid_lens = partial(make_grid_lens, rows=9, columns=11, half_mm=(2.0, 2.5), sensor_mm=(4.8, 3.6),
                         within=lambda x, y: np.maximum(abs(x) / 2.5, abs(y) / 2))
"""As `make_grid_lens`, with nodes every 0.5 mm, on a sensor that they cover, up to the end of the field."""


def turned_coma(x_mm, y_mm):
    """The PSFs of `comatic_lens` at its heights, mixed between them, and turned to a place: +v points upwards."""
    ideal_mm = np.hypot(x_mm, y_mm)
    ideal_mm = (1 - np.sqrt(1 - 0.08 * ideal_mm)) / 0.04
    position = min(ideal_mm * 5 / 2, 5.0)
    psf = 0.0
    for height, weight in ((int(position), 1 - position % 1), (int(position) + 1, position % 1)):
        round_um = gaussian_at(x_mm, y_mm, 2, 2, 2.5 * height)
        psf = psf + weight * (0.5 * gaussian_at(x_mm, y_mm, 4, 2 + height, 0) + 0.5 * round_um)
    return psf


def gaussian_at(x_mm, y_mm, sigma_out_um, sigma_along_um, moved_um, pitch_um=2.5, window=25):
    """A Gaussian that is moved outwards at a place, and turned with it: (v, u), upwards and to the right."""
    up, right = np.meshgrid(*2 * [(np.arange(window) - window // 2) * pitch_um], indexing="ij")
    angle_rad = np.arctan2(y_mm, x_mm)
    out, along = (np.cos(angle_rad) * right + np.sin(angle_rad) * up - moved_um,
                  np.sin(angle_rad) * right - np.cos(angle_rad) * up)
    psf = np.exp(-out**2 / (2 * sigma_out_um**2) - along**2 / (2 * sigma_along_um**2))
    return psf / psf.sum()


def comatic_grid(rows=5, columns=7, **changes):
    """`comatic_lens` on a grid."""
    def source_mm(nm, x, y):
        real = np.hypot(x, y)
        scale = np.where(real > 0, (1 - np.sqrt(1 - 0.08 * real)) / 0.04 / np.where(real > 0, real, 1), 1)
        return scale * x, scale * y

    return make_grid_lens(turned_coma, source_mm, rows=rows, columns=columns, **changes)


def lopsided_grid(**changes):
    """Different PSFs, distortion and illumination in all quadrants."""
    return make_grid_lens(
        lambda x, y: 0.6 * gaussian_psf(4, 2 + abs(x), 2.5, 17)
        + 0.4 * np.roll(gaussian_psf(2, 2, 2.5, 17), (round(3 * y), round(2 + 1.5 * x)), (0, 1)),
        lambda nm, x, y: (x * (1 + 0.02 * x + 1e-5 * nm) + 0.01 * y**2, y * (1 - 0.03 * y) + 0.02 * x),
        lambda nm, x, y: 1 / (1 + 0.1 * (x + 0.4)**2 + 0.2 * y**2), **changes)


def placed_psfs(lens, wavelength_nm, pitch_um, centre_px):
    """PSFs of the chief rays that land at positions of a grid: a function of (rows, columns), and their reach."""
    optics = lens.at_wavelength(wavelength_nm)
    bank, field = PsfBank.of(optics, pitch_um), FieldGeometry(optics, lens.name)

    grid = PixelGrid((1, 1), pitch_um, centre_px)

    def psfs(rows, columns):
        x_mm, y_mm = grid.position_mm(rows, columns)
        return bank.psfs(field.paraxial_height_mm(np.hypot(x_mm, y_mm)), np.arctan2(y_mm, x_mm))

    return psfs, bank.radius_px


def distance_of_light(result, truth):
    """Sum of |error| as a fraction of the light, as `Options.accuracy` defines it."""
    return np.abs(np.asarray(result, dtype=float) - truth).sum() / np.sum(truth, dtype=float)


def points_image(points, shape=(61, 73), wavelengths_nm=(550.0,), pitch_um=5.0, **facts):
    """Radiance 1 at these (x, y) in pixels right of and above the axis, at every wavelength; black elsewhere."""
    centre = facts.get("centre_px") or ((shape[0] - 1) / 2, (shape[1] - 1) / 2)
    cube = np.zeros((len(wavelengths_nm), *shape))
    for x, y in points:
        cube[:, int(centre[0] - y), int(centre[1] + x)] = 1
    return SpectralImage(cube, wavelengths_nm, pitch_um=pitch_um, **facts)


def lit_pixels(image, plane=0):
    """{(x, y): value / brightest} of the pixels that light falls on, in pixels right of and above the axis.

    A sample of half a pixel, on a pixel's centre, also reaches the pixels around that; they are left out.
    """
    values = image.cube[plane] / image.cube[plane].max()
    rows, columns = np.nonzero(values > 0.15)
    return {(float(c - image.centre_px[1]), float(image.centre_px[0] - r)): float(values[r, c])
            for r, c in zip(rows, columns, strict=True)}


def brightest(image, plane=0):
    """(x, y) of the brightest pixel, in pixels right of and above the axis."""
    row, column = np.unravel_index(np.argmax(image.cube[plane]), image.cube[plane].shape)
    return float(column - image.centre_px[1]), float(image.centre_px[0] - row)


def images_of_points(points, lens, **facts):
    """The lit pixels in the image of these points."""
    return lit_pixels(simulate(points_image(points, **facts), lens, PIXEL_BY_PIXEL))
