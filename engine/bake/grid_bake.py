"""Lens data of lenses without rotational symmetry: tables over places on the sensor."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..lens.grid_lens import GridLens
from ..prescription.mirrors import mirrored
from ..prescription.system import System
from ..rays.fields import FieldPoints, find_fields, trace_fields, view_of
from ..rays.pupil import polynomial_weights
from ..rays.rays import FullPupil
from ..rays.view import View
from ..runtime.errors import LensError
from .field_end import within_field
from .grid_nodes import adaptive_grid_mm, first_lines_mm
from .heights import survey_psfs
from .psfs import in_threads, psfs_of
from .quality import Quality
from .sampling import limit_notes, picture_samples, sensor_mm, traced_nm
from .wavefront import Wavefronts, wavefronts_of
from .window import needed_width_um, pitch_for_um

MARGIN = 1.04  # of the grid, relative to the sensor
PUPIL = FullPupil(13, 32)  # of the survey
AT_ONCE = 8  # places in a step of a thread
BETWEEN = "In the middle of the grid's cells and of their edges"


@dataclass(frozen=True, eq=False)
class Nodes:
    """The nodes of a grid on the sensor, in coordinates of the image: arrays (2, node) and (node,).

    Attributes
    ----------
    lines_mm : (array, array)
        The rows' y and the columns' x in the upright picture.
    place_mm : array (2, node)
    inside_mm : array (2, node)
        The same or, outside of the field, places towards the axis at its end.
    within : array (node,)
        Distance from the axis relative to the end of the field.
    """

    lines_mm: tuple[np.ndarray, np.ndarray]
    place_mm: np.ndarray
    inside_mm: np.ndarray
    within: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.lines_mm[0].size, self.lines_mm[1].size


def bake_grid(system: System, quality: Quality, wavelengths_nm: np.ndarray, pitch_um: float | None,
              samples: int | None, workers: int | None, progress: Callable[[float, str], object]) -> GridLens:
    """Compute the lens data of a lens without rotational symmetry; parameters as of `bake`."""
    view = view_of(system)
    lines_mm, between = _lines(system, view, wavelengths_nm, quality)
    nodes = _nodes(system, view, lines_mm, wavelengths_nm)
    needed_um = needed_width_um(_survey(system, view, nodes.inside_mm, _few_nm(wavelengths_nm)))
    samples = samples or picture_samples(needed_um, sensor_mm(system), quality)
    sample_um = pitch_um or pitch_for_um(needed_um, samples)
    tables = _Tables(system, view, nodes, quality, wavelengths_nm, sample_um, samples)
    in_threads(tables.compute, -(-nodes.within.size // AT_ONCE), workers, progress)
    notes = limit_notes(system.prescription.notes, tables.fringes.max(), BETWEEN, between, quality)
    return _lens(system, view, nodes, tables, notes)


def _few_nm(wavelengths_nm):
    """The wavelengths of surveys."""
    return wavelengths_nm[np.unique([0, wavelengths_nm.size // 2, wavelengths_nm.size - 1])]


def _lines(system, view: View, wavelengths_nm, quality: Quality):
    """Lines of the grid, y and x in the upright picture, and the share of misplaced light between its nodes."""
    prescription = system.prescription
    coarse_mm = first_lines_mm(sensor_mm(system), mirrored(prescription), MARGIN)
    if np.isinf(quality.between):
        return coarse_mm, 0.0
    middle = np.argmin(np.abs(wavelengths_nm - prescription.reference_wavelength_nm))
    survey_nm = wavelengths_nm[[middle]]
    width_um = needed_width_um(_survey(system, view, _nodes(system, view, coarse_mm, survey_nm).inside_mm, survey_nm))

    def psfs_at(y_mm, x_mm):
        places_mm, _ = within_field(system, view, -np.stack([x_mm, y_mm]), survey_nm)
        return survey_psfs(system, _survey(system, view, places_mm, survey_nm), width_um)[:, 0]

    *lines_mm, error = adaptive_grid_mm(coarse_mm, psfs_at, quality.between, quality.most_nodes)
    return tuple(lines_mm), error


def _nodes(system, view, lines_mm, wavelengths_nm):
    y_mm, x_mm = (each.ravel() for each in np.meshgrid(*lines_mm, indexing="ij"))
    place_mm = -np.stack([x_mm, y_mm])
    return Nodes(lines_mm, place_mm, *within_field(system, view, place_mm, _few_nm(wavelengths_nm)))


def _survey(system, view, places_mm, wavelengths_nm):
    """Wavefronts of a few rays, of places on the sensor."""
    points = find_fields(system, view, places_mm, wavelengths_nm)
    return wavefronts_of(system, trace_fields(system, view, points, PUPIL))


class _Tables:
    """The tables over wavelengths and nodes, which are computed in steps.

    Attributes
    ----------
    points : FieldPoints
    area, flux : arrays (wavelength, node)
        Irradiance under uniform radiance, in sr: the area in direction cosines of the bundle at the image point; and
        the light that an element of the object sends through the lens, over the element's image area by chief rays.
    psf : array (wavelength, node, v, u)
        As shares of all light, in the upright picture.
    fringes : array (node,)
    """

    def __init__(self, system, view, nodes: Nodes, quality: Quality, wavelengths_nm, pitch_um, samples):
        self._system, self._view, self._quality = system, view, quality
        self._pitch_um, self._samples, self._pupil = pitch_um, samples, quality.full_pupil
        self.points = find_fields(system, view, nodes.inside_mm, wavelengths_nm)
        self._traced = find_fields(system, view, nodes.inside_mm, traced_nm(wavelengths_nm, quality.traced))
        shape = wavelengths_nm.size, nodes.within.size
        self.area, self.flux, self.fringes = np.empty(shape), np.empty(shape), np.empty(shape[1])
        self.psf = np.zeros((*shape, samples, samples), np.float32)
        self.energy = np.zeros(shape)

    def compute(self, step, stopped):
        """Compute the tables of some nodes."""
        nodes = slice(step * AT_ONCE, (step + 1) * AT_ONCE)
        traced = wavefronts_of(self._system, trace_fields(self._system, self._view, self._traced.at(nodes),
                                                          self._pupil))
        self._illuminate(nodes, traced)
        wavefronts = traced.at(self.points.wavelengths_nm)
        for number, node in enumerate(range(*nodes.indices(self.fringes.size))):
            psf, self.fringes[node] = psfs_of(traced, wavefronts, number, self._pitch_um, self._samples, self._quality,
                                              stopped)
            self.energy[:, node] = psf.sum(axis=(1, 2))
            self.psf[:, node] = psf[:, ::-1, ::-1] / self.energy[:, node, None, None]

    def _illuminate(self, nodes, traced: Wavefronts):
        area, source_area = traced.areas(*self._quality.edges)
        weights = polynomial_weights(1e3 / traced.wavelengths_nm, 1e3 / self.points.wavelengths_nm)
        (a, b), (c, d) = self._traced.change[..., nodes]
        self.area[:, nodes] = weights @ area
        self.flux[:, nodes] = weights @ (source_area * np.abs(a * d - b * c))


def _lens(system: System, view: View, nodes: Nodes, tables: _Tables, notes):
    """The `GridLens` with the baked tables."""
    prescription, shape = system.prescription, (-1, *nodes.shape)
    middle = int(np.argmin(np.hypot(*nodes.place_mm)))
    area, flux, reference_area = tables.area, tables.flux, _reference_area(system, view, tables._quality)
    per_tangent = _focal_length_mm(system) / np.array([system.squeeze, 1.0])
    beyond = np.einsum("ijwn,jn->iwn", tables.points.change, nodes.place_mm - nodes.inside_mm)
    source_mm = -np.moveaxis(tables.points.tangent + beyond, 0, -1) * per_tangent
    dark = np.argwhere(area <= 0)
    if dark.size:
        raise _dark(system, nodes.inside_mm[:, dark[0, 1]])
    return GridLens(
        name=prescription.name, maker=prescription.maker, story=prescription.story, source=prescription.source,
        notes=notes, efl_mm=system.efl_mm, magnification=system.magnification,
        f_number_effective=0.5 / np.sqrt(reference_area / np.pi), object_distance_mm=prescription.object_distance_mm,
        entrance_pupil_mm=system.entrance_pupil_mm, sensor_mm=sensor_mm(system),
        reference_wavelength_nm=prescription.reference_wavelength_nm, wavelengths_nm=tables.points.wavelengths_nm,
        y_mm=nodes.lines_mm[0], x_mm=nodes.lines_mm[1], mirrored=mirrored(prescription),
        source_mm=source_mm.reshape(*shape, 2), within=nodes.within.reshape(nodes.shape), squeeze=system.squeeze,
        focus_slope=tuple(-view.lean / per_tangent),
        relative_illumination=(area / area[:, middle, None]).reshape(shape),
        psf=tables.psf.reshape(*shape, *tables.psf.shape[2:]), psf_pitch_um=tables._pitch_um,
        enclosed_energy=np.minimum(tables.energy, 1).reshape(shape),
        transmittance=system.transmittance(tables.points.wavelengths_nm),
        point_flux=(flux / area * area[:, middle, None] / reference_area).reshape(shape))


def _focal_length_mm(system):
    if system.object_at_infinity:
        return system.efl_mm
    return abs(system.magnification) * (system.prescription.object_distance_mm + system.entrance_pupil_mm)


def _reference_area(system, view, quality: Quality):
    """Area in direction cosines of the bundle in the middle of the picture at the reference wavelength: the lens's
    f-number."""
    points = find_fields(system, view, np.zeros((2, 1)), [system.prescription.reference_wavelength_nm])
    traced = wavefronts_of(system, trace_fields(system, view, points, quality.full_pupil))
    return traced.areas(*quality.edges)[0][0, 0]


def _dark(system, place_mm):
    return LensError(system.prescription.name, "field", f"at {np.hypot(*place_mm):.4g} mm from the axis",
                     "no light passes the apertures here: reduce the field")
