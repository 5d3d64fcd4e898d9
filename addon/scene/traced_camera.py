"""The traced camera: Cycles sends every sample from the sensor through the lens's own surfaces, at one wavelength.

It renders the sensor's irradiance, in W m^-2 if the scene's radiance is in W m^-2 sr^-1: each pixel's mean of
throughput times radiance. It includes geometry and vignetting at every depth, but not diffraction.
"""

import hashlib
from functools import lru_cache
from importlib.resources import files

import _cycles
import numpy as np

from lensfield.engine.kernels.tracing import KINDS
from lensfield.engine.rays.from_sensor import FromSensor, lens_from_sensor
from lensfield.engine.rays.sensor_aim import Bins
from lensfield.engine.runtime.errors import InputError, LensError
from lensfield.engine.runtime.files import temporary_folder

from .units import mm_per_unit

SHADER = files(__package__) / "traced_camera.osl"
NEWTON_STEPS, GOOD_SHARE = 12, 2e-6  # for aspheres: most steps; a step up to this share of the lens's length ends them
LEAST_SQUARE = 1e-12  # next to the vertex, and beyond the conic's end
WIDE_MM = 1e9  # for an infinite semi-aperture


def check_traceable(lens):
    """Raise an InputError unless this Blender can trace rays through this lens."""
    if not _cycles.with_osl:
        raise InputError("Blender", "OSL", "missing from this build",
                         "a traced lens needs it: use Blender from blender.org, or choose another Depth")
    if lens.prescription is None:
        raise LensError(lens.name, "surface data", "not in the package",
                        "a traced lens needs it: use the lens's prescription, or choose another Depth")


def trace_lens(scene, lens, film, wavelength_nm, journal):
    """Set the scene up for a render through a lens at one wavelength; its camera's data must be a stand-in."""
    set_traced_camera(scene.camera.data, lens, film, wavelength_nm, mm_per_unit(scene), journal)


def set_traced_camera(camera, lens, film, wavelength_nm, unit_mm, journal):
    """Make camera data a lens for one wavelength: it looks along -z, from the entrance pupil at its origin.

    Parameters
    ----------
    camera : bpy.types.Camera
    lens : Lens
    film : PixelGrid
        The render's pixels.
    wavelength_nm : float
    unit_mm : float
        Length of a Blender unit.
    journal : Journal
    """
    for name in ("shift_x", "shift_y"):
        journal.set(camera, name, 0.0)  # the film has it already
    use_shader(camera, _shader(lens.prescription, film, float(wavelength_nm), unit_mm), journal)


@lru_cache(maxsize=64)  # one for each wavelength of a film: each frame of an animation uses them in turn
def _shader(prescription, film, wavelength_nm, unit_mm):
    lens = lens_from_sensor(prescription, wavelength_nm, film.edges_mm)
    return shader_text(lens, film, unit_mm)


def use_shader(camera, text, journal):
    """Give camera data an OSL shader."""
    bytecode = _compiled(text)
    digest = hashlib.md5(bytecode.encode(), usedforsecurity=False).hexdigest()
    for name, value in (("type", "CUSTOM"), ("custom_bytecode", bytecode), ("custom_bytecode_hash", digest)):
        journal.set(camera, name, value)


@lru_cache(maxsize=64)
def _compiled(text):
    with temporary_folder() as folder:
        source, compiled = folder / "lens.osl", folder / "lens.oso"
        source.write_text(text, encoding="utf-8")
        if not _cycles.osl_compile(str(source), str(compiled)):
            raise InputError("traced lens", "camera shader", "not compiled", "see the compiler's messages above")
        return compiled.read_text(encoding="utf-8")


def shader_text(lens: FromSensor, film, unit_mm):
    """OSL source of the camera for a lens and a film, in a scene whose Blender unit has this length."""
    (rows, columns), pitch_mm = film.shape_px, film.pitch_um * 1e-3
    x_mm, y_mm = film.position_mm((rows - 1) / 2, (columns - 1) / 2)
    numbers = {
        "CENTRE_X": x_mm - lens.origin_mm[0], "CENTRE_Y": y_mm - lens.origin_mm[1], "WIDTH": columns * pitch_mm,
        "HEIGHT": rows * pitch_mm, "ENTRANCE_PUPIL": lens.entrance_pupil_mm, "COUNT": lens.gap_mm.size,
        "APART": lens.gap_mm, "CURVATURE": lens.curvature_per_mm, "CONIC": lens.conic,
        "SEMI": np.minimum(lens.semi_aperture_mm, WIDE_MM), "HOLE": lens.semi_obstruction_mm, "ETA": lens.index_ratio,
        "ABSORPTION": lens.absorption_per_mm, "COATINGS": lens.coating_transmittance, "ASPHERIC": lens.terms,
        "TERMS": lens.terms.size,
        "BENT": lens.terms.any(axis=1).astype(int), "TERMS_EACH": lens.terms.shape[1],
        "FIRST_POWER": lens.first_power, "POWER_STEP": lens.power_step,
        "NEWTON_STEPS": NEWTON_STEPS, "GOOD_MM": GOOD_SHARE * np.abs(lens.gap_mm).sum(), "LEAST_SQUARE": LEAST_SQUARE,
        "UNIT_MM": unit_mm, **_aim_numbers(lens.aim), **_section_numbers(lens.sections),
        **_rectangle_numbers(lens.half_widths_mm)}
    numbers = {name: ", ".join(map(repr, np.ravel(value).tolist())) for name, value in numbers.items()}
    definitions = "".join(f"#define {name} {text}\n" for name, text in (numbers | _matrices(lens.poses)).items())
    return definitions + SHADER.read_text(encoding="utf-8")


def _aim_numbers(aim):
    if isinstance(aim, Bins):
        return {"BINS": aim.low_mm.size, "BIN_MM": aim.bin_mm, "TO_PUPIL": aim.to_pupil, "LOW": aim.low_mm,
                "HIGH": aim.high_mm, "HALF": aim.half_mm}
    pairs = {"FIRST": aim.first_mm, "CELL": aim.cell_mm, "TO_PUPIL": aim.to_pupil, "LOW": aim.low_mm,
             "HIGH": aim.high_mm}
    rows, columns = aim.low_mm.shape[1:]
    return {"CELLS": rows * columns, "ROWS": rows, "COLUMNS": columns, "AWAY": aim.away_mm} | {
        f"{name}_{axis}": value for name, pair in pairs.items() for axis, value in zip("XY", pair, strict=True)}


def _section_numbers(sections):
    if sections is None:
        return {}
    return {"KINDS": sections.kinds, "ALONG_X": sections.along_x, "SECTIONS": sections.along_x.size,
            "SECTIONS_EACH": sections.along_x.shape[1], "TOROID_X": KINDS["x"], "TOROID_Y": KINDS["y"]}


def _rectangle_numbers(half_widths_mm):
    if half_widths_mm is None:
        return {}
    return {f"HALF_WIDTH_{axis}": np.minimum(half_mm, WIDE_MM)
            for axis, half_mm in zip("XY", half_widths_mm.T, strict=True)}


def _matrices(poses):
    """The poses as OSL's matrices, which multiply rows from the right."""
    if poses is None:
        return {}
    return {name: ", ".join(f"matrix({', '.join(map(repr, each.T.ravel().tolist()))})" for each in matrices)
            for name, matrices in (("TO_SURFACE", poses.to_surface), ("TO_CAMERA", [poses.to_camera]))}
