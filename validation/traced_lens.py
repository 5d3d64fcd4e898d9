"""The real lens as a camera: Cycles sends every sample from the sensor through the lens's surfaces, at one wavelength.

It knows geometry and vignetting, at every depth; it knows no diffraction. So it is the truth that lens data are held
against where aberrations rule, and what somebody would use instead of them.

A sample starts anywhere in its pixel and aims at a rectangle about what can be seen of the exit pupil from there. The
irradiance of the sensor, integral of L cos(t) dw, is an integral over the plane of the rear vertex, at the distance z:
cos^4(t) / z^2 dA; so each pixel's mean of throughput times radiance is its irradiance, in W m^-2 where the scene's
radiance is in W m^-2 sr^-1.
"""

import hashlib
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import _cycles
import bpy
import numpy as np

from lensfield.addon import render_through_lens
from lensfield.commands.terminal import quiet
from lensfield.engine.errors import InputError
from lensfield.engine.files import temporary_folder
from lensfield.engine.image.spectral_exr import read_exr

BINS = 32  # of sensor heights, each with its own rectangle
SEARCH = 96  # rays along a side, to find what of the exit pupil can be seen
REACH = 1.5  # of the search, in semi-apertures of the widest surface
NEWTON_STEPS, GOOD_MM = 12, 1e-4  # for aspheres
LEAST_SQUARE = 1e-12  # beyond the conic's end a ray may come by on its way to a place where there is a surface
WIDE_MM = 1e9  # stands for a semi-aperture without end

SHADER = Path(__file__).with_suffix(".osl")


@dataclass(frozen=True)
class Window:
    """A patch of the sensor, as the upright picture shows it.

    Attributes
    ----------
    shape_px : (int, int)
        Rows and columns.
    pitch_um : float
    centre_mm : (float, float)
        Of its middle from the axis, to the right and upwards.
    """

    shape_px: tuple[int, int]
    pitch_um: float
    centre_mm: tuple[float, float] = (0.0, 0.0)

    @property
    def size_mm(self):
        """Height and width."""
        return tuple(n * self.pitch_um * 1e-3 for n in self.shape_px)

    def places_mm(self):
        """Where its pixels are: x and y from the axis, arrays (row, column)."""
        rows, columns = (np.arange(n) - (n - 1) / 2 for n in self.shape_px)
        x, y = np.meshgrid(columns, -rows)
        return (self.centre_mm[0] + x * self.pitch_um * 1e-3, self.centre_mm[1] + y * self.pitch_um * 1e-3)


class Backwards:
    """Surfaces in the order in which rays from the sensor meet them, arrays (surface,); z grows towards the scene."""

    def __init__(self, surfaces, wavelength_nm):
        index, absorption = surfaces.at(wavelength_nm)
        self.apart_mm = surfaces.thickness_mm[::-1]
        self.curvature = -1 / surfaces.radius_mm[::-1]
        self.conic = surfaces.conic[::-1]
        self.aspheric = -surfaces.aspheric[::-1]
        self.semi_aperture_mm = np.minimum(surfaces.semi_aperture_mm[::-1], WIDE_MM)
        self.eta = index[::-1] / np.append(index[-2::-1], 1.0)
        self.absorption_per_mm = absorption[::-1]


def passing(lens, position_mm, direction):
    """Which rays from the sensor get through: bool array (ray,).

    Parameters
    ----------
    lens : Backwards
    position_mm : array (3, ray)
        On the sensor.
    direction : array (3, ray), of length 1
    """
    p, d, alive = position_mm.astype(float), direction.astype(float), np.ones(position_mm.shape[1], bool)
    with np.errstate(invalid="ignore"):
        for apart, c, k, terms, semi, eta in zip(lens.apart_mm, lens.curvature, lens.conic, lens.aspheric,
                                                 lens.semi_aperture_mm, lens.eta, strict=True):
            p[2] -= apart
            p -= p[2] / d[2] * d
            p, normal = _meet(p, d, c, k, terms)
            alive &= np.hypot(p[0], p[1]) <= semi
            along = np.sum(d * normal, axis=0)
            d = eta * d + (np.sqrt(1 - eta**2 * (1 - along**2)) - eta * along) * normal
    return alive & np.isfinite(d).all(axis=0)


def _meet(p, d, c, k, terms):
    """Where rays that start on the vertex plane meet a surface, and its normal; NaN where they do not."""
    if not terms.any():
        f, g = c * (p[0]**2 + p[1]**2), d[2] - c * (p[0] * d[0] + p[1] * d[1])
        p = p + f / (g + np.sqrt(g**2 - f * c * (1 + k * d[2]**2))) * d
        normal = np.stack([-c * p[0], -c * p[1], 1 - c * (1 + k) * p[2]])
    else:
        p, slope = _meet_asphere(p, d, c, k, terms)
        normal = np.stack([-2 * slope * p[0], -2 * slope * p[1], np.ones_like(slope)])
    return p, normal / np.linalg.norm(normal, axis=0)


def _meet_asphere(p, d, c, k, terms):
    """The same by Newton's method, and the slope: the sag's derivative by the squared distance from the axis."""
    powers = np.arange(1, terms.size + 1)
    for _ in range(NEWTON_STEPS):
        square = p[0]**2 + p[1]**2
        root = np.sqrt(np.maximum(1 - (1 + k) * c**2 * square, LEAST_SQUARE))
        raised = square[:, None] ** (powers - 1)
        slope = c / (2 * root) + raised @ (powers * terms)
        step = (c * square / (1 + root) + square * (raised @ terms) - p[2]) / (
            d[2] - 2 * slope * (p[0] * d[0] + p[1] * d[1]))
        p = p + step * d
    return np.where(np.abs(step) < GOOD_MM, p, np.nan), slope


def exit_pupil_boxes(lens, heights_mm):
    """Rectangles on the plane of the rear vertex that hold all rays from sensor points of these heights.

    Parameters
    ----------
    lens : Backwards
    heights_mm : array (height,)

    Returns
    -------
    array (3, height)
        The ends on the line away from the axis, and half the extent across; 0 where no light gets through.
    """
    reach_mm = REACH * max(semi for semi in lens.semi_aperture_mm if semi < WIDE_MM)
    boxes = []
    for height_mm in heights_mm:
        box = -reach_mm, reach_mm, reach_mm
        for _ in range(2):  # roughly, then well
            box = _box_of_what_passes(lens, height_mm, *box)
        boxes.append(box)
    return np.array(boxes).T


def _box_of_what_passes(lens, height_mm, low_mm, high_mm, half_mm):
    """The rectangle, and a step of the search around it, that holds what passes of a rectangle's rays."""
    across, step_x = np.linspace(low_mm, high_mm, SEARCH, retstep=True)
    up, step_y = np.linspace(0, half_mm, SEARCH // 2, retstep=True)
    x, y = (part.ravel() for part in np.meshgrid(across, up))
    start = np.stack([np.full(x.size, height_mm), 0 * x, 0 * x])
    direction = np.stack([x, y, np.full(x.size, lens.apart_mm[0])]) - start
    through = passing(lens, start, direction / np.linalg.norm(direction, axis=0))
    if not through.any():
        return 0.0, 0.0, 0.0
    return x[through].min() - step_x, x[through].max() + step_x, y[through].max() + step_y


def shader_text(surfaces, wavelength_nm, window, margins_px=(0, 0)):
    """The OSL camera of a lens for one wavelength and a patch of its sensor, with dark rows and columns around it."""
    lens = Backwards(surfaces, wavelength_nm)
    height_mm, width_mm = window.size_mm
    outer_mm = [(n + 2 * margin) * window.pitch_um * 1e-3
                for n, margin in zip(window.shape_px, margins_px, strict=True)]
    farthest_mm = np.hypot(abs(window.centre_mm[0]) + width_mm / 2, abs(window.centre_mm[1]) + height_mm / 2)
    low, high, half = exit_pupil_boxes(lens, np.linspace(0, farthest_mm, BINS + 1))
    numbers = {
        "BINS": BINS, "BIN_MM": farthest_mm / BINS, "LOW": np.minimum(low[:-1], low[1:]),
        "HIGH": np.maximum(high[:-1], high[1:]), "HALF": np.maximum(half[:-1], half[1:]),
        "CENTRE_X": window.centre_mm[0], "CENTRE_Y": window.centre_mm[1], "WIDTH": width_mm, "HEIGHT": height_mm,
        "OUTER_WIDTH": outer_mm[1], "OUTER_HEIGHT": outer_mm[0], "ENTRANCE_PUPIL": surfaces.entrance_pupil_mm,
        "COUNT": lens.curvature.size, "APART": lens.apart_mm, "CURVATURE": lens.curvature, "CONIC": lens.conic,
        "SEMI": lens.semi_aperture_mm, "ETA": lens.eta, "ABSORPTION": lens.absorption_per_mm,
        "ASPHERIC": lens.aspheric, "TERMS": lens.aspheric.size, "TERMS_EACH": lens.aspheric.shape[1],
        "NEWTON_STEPS": NEWTON_STEPS, "GOOD_MM": GOOD_MM, "LEAST_SQUARE": LEAST_SQUARE}
    definitions = "".join(f"#define {name} {', '.join(map(repr, np.ravel(value).tolist()))}\n"
                          for name, value in numbers.items())
    return definitions + SHADER.read_text(encoding="utf-8")


def set_traced_lens(camera, text):
    """Make camera data the lens of a `shader_text`: it looks along -z, from the entrance pupil at its origin."""
    with temporary_folder() as folder:
        source, compiled = folder / "lens.osl", folder / "lens.oso"
        source.write_text(text)
        if not _cycles.osl_compile(str(source), str(compiled)):
            raise InputError("traced lens", "camera shader", "refused", "see the compiler's messages above")
        bytecode = compiled.read_text()
    camera.type = "CUSTOM"
    camera.custom_bytecode = bytecode
    camera.custom_bytecode_hash = hashlib.md5(bytecode.encode()).hexdigest()


def photograph(scene, surfaces, wavelength_nm, window, *, samples, seed=0):
    """The scene through the traced lens: Lensfield's own capture at one wavelength, but for the camera.

    Parameters
    ----------
    scene : bpy.types.Scene
    surfaces : Surfaces
        Of a lens in Lensfield's library.
    wavelength_nm : float
    window : Window
    samples : int
    seed : int
        Beyond the scene's own.

    Returns
    -------
    picture : array (row, column), W m^-2 nm^-1
    seconds : array (2,)
        Of all cores together, and by the clock, that Blender's render took.
    """
    render, cycles = scene.render, scene.cycles
    before = render.resolution_y, render.resolution_x, cycles.samples, cycles.seed
    (render.resolution_y, render.resolution_x), cycles.samples = window.shape_px, samples
    cycles.seed += seed
    try:
        with temporary_folder() as folder, _lens_put_in(surfaces, wavelength_nm, window) as seconds:
            with quiet(1):  # Blender says where it saves each pass
                result = render_through_lens(scene, surfaces.name, [wavelength_nm], folder)
            captured = read_exr(result.radiance)
    finally:
        render.resolution_y, render.resolution_x, cycles.samples, cycles.seed = before
    return captured.frame().cube[0].astype(float), np.diff(seconds, axis=0)[0]


@contextmanager
def _lens_put_in(surfaces, wavelength_nm, window):
    """Whatever is rendered has the traced lens for its camera; gives a list of times before and after the render."""
    times = []

    def begin(scene, _):
        outer_px = scene.render.resolution_y, scene.render.resolution_x
        margins_px = [(outer - inner) // 2 for outer, inner in zip(outer_px, window.shape_px, strict=True)]
        set_traced_lens(scene.camera.data, shader_text(surfaces, wavelength_nm, window, margins_px))
        end()

    def end(*_):
        times.append((time.process_time(), time.perf_counter()))

    bpy.app.handlers.render_init.append(begin)
    bpy.app.handlers.render_complete.append(end)
    try:
        yield times
    finally:
        bpy.app.handlers.render_init.remove(begin)
        bpy.app.handlers.render_complete.remove(end)
