"""A `Lens` of a measured distortion, with the blur of a perfect lens or of a designed one.

A calibration that is rotationally symmetric about the middle of the frame becomes a `RadialLens`, and any other a
`GridLens`, which has the principal point, the two focal lengths and tangential terms in its places.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy

from ..field.field_map import field_map
from ..lens import GridLens, Lens, RadialLens
from ..runtime.errors import LensError
from .blur import Blur, upright
from .camera import CHANNELS_NM, Measured, ModelledCamera, pixel_mm
from .inverse import MOST_ANGLE_DEG, directions

MARGIN = 1.04  # of the lens data, relative to the frame: the blur of light from beyond it
HEIGHTS = 65
TARGET_PX, RADIAL_PX, WORST_PX = 0.005, 0.01, 0.02  # of the lens's distortion, from the calibration's
NODES = 9, 17, 25, 33, 49  # along the longer side of the frame
LEAST_NODES = 7
ANAMORPHIC = 0.05  # difference of the focal lengths from which on a picture counts as squeezed
DENSER_RAD = 1.2
CHECKED = 4  # places between nodes
NEARLY = 0.99
BORDER = 65  # places along each side of the frame


def measured_lens(measured: Measured, sensor_mm: tuple[float, float], focus_mm: float,
                  blur_at: Callable[[float], Blur]) -> Lens:
    """The lens with a measured distortion.

    Parameters
    ----------
    measured : Measured
    sensor_mm : (float, float)
        Width and height of a sensor, in which the frame fits; turned for a portrait picture.
    focus_mm : float
        Distance from the entrance pupil to the plane of focus; inf for infinity.
    blur_at : function (magnification) -> Blur

    Raises
    ------
    LensError
        The focus or the sensor is not positive, the plane of focus is closer than the focal length; or the distortion
        is not that of a lens.
    """
    columns, rows = measured.size_px
    pitch_mm = pixel_mm(measured.name, sensor_mm, measured.size_px)
    focal_mm = measured.focal_px[1] * pitch_mm
    if not focus_mm > focal_mm:
        raise LensError(measured.name, "focus", f"{focus_mm:g} mm",
                        f"expected more than the focal length, {focal_mm:.4g} mm")
    magnification = 0.0 if np.isinf(focus_mm) else -focal_mm / focus_mm
    blur = blur_at(magnification)
    facts = {
        "name": measured.name, "efl_mm": focal_mm / (1 - magnification), "magnification": magnification,
        "f_number_effective": blur.f_number_effective, "object_distance_mm": focus_mm, "entrance_pupil_mm": 0.0,
        "sensor_mm": (columns * pitch_mm, rows * pitch_mm), "reference_wavelength_nm": blur.reference_nm,
        "wavelengths_nm": blur.wavelengths_nm, "psf_pitch_um": blur.pitch_um, "transmittance": blur.transmittance,
        "source": f"Distortion as measured ({measured.program}), {blur.words}, defocus of a thin lens.",
        "notes": "\n".join([*measured.notes, *_end_notes(measured), *_blur_notes(measured, pitch_mm, blur)])}
    if isinstance(measured, ModelledCamera) and measured.symmetric:
        lens = _radial_lens(measured, pitch_mm, blur, facts)
        if lens is not None:
            return lens
    return _grid_lens(measured, pitch_mm, blur, facts)


def _end_notes(measured):
    """A sentence about the end of the field, if it is inside the frame."""
    columns, rows = measured.size_px
    across, down = (np.linspace(-0.5, side - 0.5, BORDER) for side in (columns, rows))
    border = np.concatenate([np.stack(np.broadcast_arrays(x, y), axis=-1).reshape(-1, 2) for x, y in (
        (across, -0.5), (across, rows - 0.5), (-0.5, down), (columns - 0.5, down))])
    end = measured.straight(border).end
    nearest = np.argmin(end)
    if end[nearest] < 1:
        way_px = end[nearest] * (border[nearest] - measured.principal_px)
        tangents = measured.straight((measured.principal_px + way_px)[None]).tangents
        wide = np.hypot(*tangents[0]) > np.tan(np.radians(NEARLY * MOST_ANGLE_DEG))
        what = f"light comes from more than {MOST_ANGLE_DEG:g} degrees" if wide else measured.ending
        yield (f"From {np.hypot(*way_px):.0f} px from the axis, inside the frame, {what}: the lens data end there, "
               f"{end[nearest]:.0%} of the way to the frame's edge.")


def _blur_notes(measured, pitch_mm, blur):
    """A sentence about the end of the blur's data, if it is inside the frame."""
    half_mm = np.hypot(*measured.size_px) / 2 * pitch_mm
    if blur.last_mm < half_mm:
        yield f"Blur and light are constant from {blur.last_mm:.4g} mm from the axis on, where the designed lens ends."


def _radial_lens(camera, pitch_mm, blur, facts):
    """The RadialLens of a symmetric camera; None if the polynomials of its field do not follow the distortion."""
    focal_mm, half_mm = camera.focal_px[1] * pitch_mm, np.hypot(*camera.size_px) / 2 * pitch_mm
    heights_mm, real_mm = _heights(camera, focal_mm, MARGIN * half_mm)
    light = blur.at(real_mm)
    shares = real_mm / half_mm
    illumination = light.relative_illumination if camera.light is None else np.broadcast_to(
        camera.light(shares), light.relative_illumination.shape)
    lens = RadialLens(
        heights_mm=heights_mm, real_height_mm=real_mm * _fringes(camera, shares, blur.wavelengths_nm),
        relative_illumination=illumination, psf=light.psf, enclosed_energy=light.enclosed_energy, **facts)
    field = field_map(lens).at_wavelength(blur.reference_nm)
    between_mm, exact_mm = _heights(camera, focal_mm, MARGIN * half_mm, 4 * HEIGHTS)
    exact_mm = exact_mm * _fringes(camera, exact_mm / half_mm, np.array([blur.reference_nm]))[0]
    landed_mm, _ = field.landing_mm(between_mm, np.zeros_like(between_mm))
    off_px = np.abs(landed_mm - exact_mm).max() / pitch_mm
    if off_px > RADIAL_PX and not (camera.light or camera.fringes):  # which a grid lacks
        return None
    return lens if off_px <= WORST_PX else replace(lens, notes=_with_error(lens.notes, off_px))


def _with_error(notes, off_px):
    return f"{notes}\nThe distortion is up to {off_px:.2g} px off the measured one.".lstrip()


def _heights(camera, focal_mm, last_mm, count=HEIGHTS):
    """Paraxial and real heights up to a real height, or to the end of the field."""
    corner_px = last_mm / focal_mm * camera.focal_px[1]
    edge = np.array([[camera.principal_px[0] + corner_px, camera.principal_px[1]]])
    tangents, end = camera.straight(edge)
    if end[0] < 1:
        tangents, _ = camera.straight(np.array([[edge[0, 0] * end[0] + camera.principal_px[0] * (1 - end[0]),
                                                 camera.principal_px[1]]]))
    angle = np.linspace(0, np.arctan(tangents[0, 0]), count)
    along = angle if camera.model.fisheye else np.tan(angle)
    places = camera.model.place(directions(np.stack([along, 0 * along], axis=-1), camera.model.fisheye),
                                np.array(camera.coefficients))
    return focal_mm * np.tan(angle), focal_mm * places[:, 0]


def _fringes(camera, shares, wavelengths_nm):
    """Factors of real heights, (wavelength, height), linear between the wavelengths of the channels."""
    if camera.fringes is None:
        return np.ones((wavelengths_nm.size, shares.size))
    factors = np.stack([camera.fringes.blue(shares), np.ones_like(shares), camera.fringes.red(shares)])
    position = np.interp(wavelengths_nm, CHANNELS_NM, np.arange(3))
    below = np.minimum(position.astype(int), 1)
    weight = (position - below)[:, None]
    return (1 - weight) * factors[below] + weight * factors[below + 1]


def _grid_lens(measured, pitch_mm, blur, facts):
    fx, fy = measured.focal_px
    squeeze = fy / fx if abs(fy / fx - 1) > ANAMORPHIC else 1.0
    focal_mm = fy * pitch_mm * np.array([1 / squeeze, 1.0])
    columns_px, rows_px, straight, off_px = _nodes(measured)
    if np.isinf(off_px):
        raise LensError(measured.name, "distortion", "not one-to-one inside the frame",
                        "calibrate with pictures that show the corners, or with a model for fisheyes")
    shape = rows_px.size, columns_px.size
    right_px, down_px = (np.array(measured.size_px) - 1) / 2
    x_mm, y_mm = (columns_px - right_px) * pitch_mm, (down_px - rows_px[::-1]) * pitch_mm
    source_mm = focal_mm * (straight.tangents.reshape(*shape, 2)[::-1] * (1, -1))
    waves = blur.wavelengths_nm.size
    distances_mm = np.hypot(x_mm, y_mm[:, None]).ravel()
    light = blur.at(distances_mm)
    psf = upright(light.psf, np.arctan2(*np.broadcast_arrays(y_mm[:, None], x_mm)).ravel()) if blur.turns else light.psf
    if off_px > WORST_PX:
        facts |= {"notes": _with_error(facts["notes"], off_px)}
    return GridLens(
        y_mm=y_mm, x_mm=x_mm, mirrored=(False, False), squeeze=squeeze,
        source_mm=np.broadcast_to(source_mm, (waves, *source_mm.shape)),
        within=1 / straight.end.reshape(shape)[::-1],
        relative_illumination=light.relative_illumination.reshape(waves, *shape),
        enclosed_energy=light.enclosed_energy.reshape(waves, *shape), psf=psf.reshape(waves, *shape, *psf.shape[-2:]),
        **facts)


def _nodes(measured):
    """Columns and rows of nodes, as few as needed; where their light comes from; and the largest distance in pixels of
    the light between them from their places in the calibration."""
    for count in NODES:
        columns, rows = _lines(measured.size_px, count)
        between = [np.clip((line[1:] + line[:-1]) / 2, -0.5, side - 0.5)
                   for line, side in zip((columns, rows), measured.size_px, strict=True)]
        straight = measured.straight(_places(columns, rows))
        off_px = _off_px(measured, (columns, rows), straight.tangents, between)
        if off_px <= TARGET_PX:
            break
    return columns, rows, straight, off_px


def _lines(size_px, count):
    """Columns and rows of nodes, which are closer together towards the edges."""
    lines = []
    for side in size_px:
        even = np.linspace(-DENSER_RAD, DENSER_RAD, max(LEAST_NODES, round(count * side / max(size_px))))
        lines.append((side - 1) / 2 + MARGIN * side / 2 * np.sin(even) / np.sin(DENSER_RAD))
    return tuple(lines)


def _places(columns, rows):
    return np.stack(np.broadcast_arrays(columns, rows[:, None]), axis=-1).reshape(-1, 2)


def _off_px(measured, lines, tangents, between):
    """The largest distance in pixels, at places between nodes, of splines through the nodes from the calibration."""
    columns, rows = lines
    splines = [scipy.interpolate.RectBivariateSpline(rows, columns, each)  # as the field map of a GridLens
               for each in np.moveaxis(tangents.reshape(rows.size, columns.size, 2), -1, 0)]
    if _folded(splines, columns, rows):
        return np.inf
    exact, end = measured.straight(_places(*between))
    across, down = (np.stack([spline(*between[::-1]) for spline in splines], axis=-1).reshape(-1, 2) - exact).T
    (a, b), (c, d) = _slopes(splines, *between)
    off_px = np.hypot(d * across - b * down, a * down - c * across) / np.abs(a * d - b * c)
    return float(off_px[end >= 1].max(initial=0))


def _slopes(splines, columns, rows):
    """Derivatives of both splines along the columns and the rows: arrays (place,)."""
    return [[spline(rows, columns, *order).ravel() for order in ((0, 1), (1, 0))] for spline in splines]


def _folded(splines, columns, rows):
    """Whether splines are not one-to-one, near a fold of the distortion that is close to the frame."""
    finer = (np.interp(np.arange(CHECKED * (line.size - 1) + 1) / CHECKED, np.arange(line.size), line)
             for line in (columns, rows))
    (a, b), (c, d) = _slopes(splines, *finer)
    return np.any((a <= 0) | (d <= 0) | (a * d - b * c <= 0))
