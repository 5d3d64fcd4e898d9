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
from ..rays.transmission import transmittance
from ..rays.view import View
from ..runtime.errors import LensError
from .field_end import within_field
from .grid_ends import Ends, grid_ends_mm
from .grid_nodes import adaptive_grid_mm, first_lines_mm
from .heights import survey_psfs
from .psfs import in_threads, psfs_of
from .quality import Quality
from .sampling import limit_notes, picture_samples, sensor_mm, traced_nm
from .wavefront import Wavefronts, wavefronts_of
from .window import needed_width_um, pitch_for_um

LEAST = 3  # intervals of the grid from the axis to the end of the sensor, along the longer side
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


def bake_grid(system: System, quality: Quality, wavelengths_nm: np.ndarray, ends_mm: Ends,
              pitch_um: float | None, samples: int | None, workers: int | None,
              progress: Callable[[float, str], object]) -> GridLens:
    """Compute the lens data of a lens without rotational symmetry; parameters as of `bake`."""
    view = view_of(system)
    lines_mm, between = _lines(system, view, wavelengths_nm, ends_mm, quality)
    nodes = _nodes(system, view, lines_mm, wavelengths_nm)
    needed_um = needed_width_um(_survey(system, view, nodes.inside_mm, _few_nm(wavelengths_nm)))
    samples = samples or picture_samples(needed_um, sensor_mm(system), quality)
    sample_um = pitch_um or pitch_for_um(needed_um, samples)
    points = find_fields(system, view, nodes.inside_mm, traced_nm(wavelengths_nm, quality.traced))
    tables = _tables(system, view, points, wavelengths_nm, (sample_um, samples), quality, workers, progress)
    _check_light(system, nodes, tables.area)
    notes = limit_notes(system.prescription.notes, tables.fringes.max(), BETWEEN, between, quality)
    return _lens(system, view, nodes, tables, wavelengths_nm, sample_um, _reference_area(system, view, quality), notes)


def _few_nm(wavelengths_nm):
    """The wavelengths of surveys."""
    return wavelengths_nm[np.unique([0, wavelengths_nm.size // 2, wavelengths_nm.size - 1])]


def _lines(system, view: View, wavelengths_nm, ends_mm: Ends, quality: Quality):
    """Lines of the grid, y and x in the upright picture, and the share of misplaced light between its nodes."""
    prescription = system.prescription
    coarse_mm = first_lines_mm(ends_mm, max(sensor_mm(system)) / 2 / LEAST)
    if np.isinf(quality.between):
        return coarse_mm, 0.0
    middle = np.argmin(np.abs(wavelengths_nm - prescription.reference_wavelength_nm))
    survey_nm = wavelengths_nm[[middle]]
    width_um = needed_width_um(_survey(system, view, _nodes(system, view, coarse_mm, survey_nm).inside_mm, survey_nm))

    def psfs_at(y_mm, x_mm):
        places_mm, _ = within_field(system, view, -np.stack([x_mm, y_mm]), survey_nm)
        return survey_psfs(system, _survey(system, view, places_mm, survey_nm), width_um)[:, 0]

    most = round(quality.most_nodes * 2 ** (0.5 * mirrored(prescription).count(False)) * _size(system, ends_mm))
    y_mm, x_mm, error = adaptive_grid_mm(coarse_mm, psfs_at, quality.between, most)
    return (y_mm, x_mm), error


def _size(system, ends_mm: Ends):
    """Area between these ends, relative to the one for the sensor."""
    area, of_sensor = (np.prod(np.ptp(each, axis=1)) for each in (ends_mm, grid_ends_mm(system)))
    return float(area / of_sensor)


def _nodes(system, view, lines_mm, wavelengths_nm):
    y_mm, x_mm = (each.ravel() for each in np.meshgrid(*lines_mm, indexing="ij"))
    place_mm = -np.stack([x_mm, y_mm])
    return Nodes(lines_mm, place_mm, *within_field(system, view, place_mm, _few_nm(wavelengths_nm)))


def _survey(system, view, places_mm, wavelengths_nm):
    """Wavefronts of a few rays, of places on the sensor."""
    points = find_fields(system, view, places_mm, wavelengths_nm)
    return wavefronts_of(system, trace_fields(system, view, points, PUPIL))


@dataclass(frozen=True, eq=False)
class Tables:
    """Tables over wavelengths and nodes.

    Attributes
    ----------
    area, flux : arrays (wavelength, node)
        Irradiance under uniform radiance, in sr: the area in direction cosines of the bundle at the image point; and
        the light that an element of the object sends through the lens, over the element's image area by chief rays.
    psf : float32 array (wavelength, node, v, u)
        Of unit sum, in the upright picture.
    energy : array (wavelength, node)
        Share of the light in the window.
    fringes : array (node,)
        Number of the finest fringes in a sample.
    """

    area: np.ndarray
    flux: np.ndarray
    psf: np.ndarray
    energy: np.ndarray
    fringes: np.ndarray


def _tables(system, view, points: FieldPoints, wavelengths_nm, window, quality: Quality, workers, progress) -> Tables:
    """The tables at all wavelengths, from the rays of the traced ones, in a window of this pitch and samples."""
    nodes, (pitch_um, samples) = points.lost.shape[1], window
    area, flux, energy = np.zeros((3, wavelengths_nm.size, nodes))
    tables = Tables(area, flux, np.zeros((*area.shape, samples, samples), np.float32), energy, np.zeros(nodes))

    def compute(step, stopped):
        some = slice(step * AT_ONCE, (step + 1) * AT_ONCE)
        traced = wavefronts_of(system, trace_fields(system, view, points.at(some), quality.full_pupil))
        tables.area[:, some], tables.flux[:, some] = _illumination(points.at(some), traced, wavelengths_nm, quality)
        wavefronts = traced.at(wavelengths_nm)
        for number, node in enumerate(range(*some.indices(nodes))):
            psf, tables.fringes[node] = psfs_of(traced, wavefronts, number, pitch_um, samples, quality, stopped)
            tables.energy[:, node] = sums = psf.sum(axis=(1, 2))
            tables.psf[:, node] = psf[:, ::-1, ::-1] / np.maximum(sums, np.finfo(float).tiny)[:, None, None]

    in_threads(compute, -(-nodes // AT_ONCE), workers, progress)
    return tables


def _illumination(points: FieldPoints, traced: Wavefronts, wavelengths_nm, quality: Quality):
    """`Tables.area` and `Tables.flux`: array (2, wavelength, node)."""
    area, source_area = traced.areas(*quality.edges)
    (x_by_x, x_by_y), (y_by_x, y_by_y) = points.change
    flux = source_area * np.abs(x_by_x * y_by_y - x_by_y * y_by_x)
    return polynomial_weights(1e3 / traced.wavelengths_nm, 1e3 / wavelengths_nm) @ np.stack([area, flux])


def _check_light(system, nodes: Nodes, area):
    dark = np.flatnonzero(np.any(area <= 0, axis=0))
    if dark.size:
        raise LensError(system.prescription.name, "field", f"dark at {np.hypot(*nodes.inside_mm[:, dark[0]]):.4g} mm "
                        "from the middle", "no light passes the apertures here: reduce the field")


def _lens(system: System, view: View, nodes: Nodes, tables: Tables, wavelengths_nm, pitch_um, reference_area, notes):
    """The `GridLens` with the baked tables."""
    prescription, shape, area = system.prescription, (-1, *nodes.shape), tables.area
    middle_area = area[:, np.argmin(np.hypot(*nodes.place_mm)), None]
    per_tangent = system.capture_focal_length_mm / np.array([system.squeeze, 1.0])
    return GridLens(
        name=prescription.name, maker=prescription.maker, story=prescription.story, source=prescription.source,
        notes=notes, efl_mm=system.efl_mm, magnification=system.magnification,
        f_number_effective=0.5 / np.sqrt(reference_area / np.pi), central_obstruction=system.central_obstruction,
        object_distance_mm=prescription.object_distance_mm, entrance_pupil_mm=system.entrance_pupil_mm,
        sensor_mm=sensor_mm(system),
        reference_wavelength_nm=prescription.reference_wavelength_nm, wavelengths_nm=wavelengths_nm,
        y_mm=nodes.lines_mm[0], x_mm=nodes.lines_mm[1], mirrored=mirrored(prescription),
        source_mm=(_source_tangent(system, view, nodes, wavelengths_nm) * per_tangent).reshape(*shape, 2),
        within=nodes.within.reshape(nodes.shape), squeeze=system.squeeze, focus_slope=tuple(-view.lean / per_tangent),
        relative_illumination=(area / middle_area).reshape(shape),
        psf=tables.psf.reshape(*shape, *tables.psf.shape[2:]), psf_pitch_um=pitch_um,
        enclosed_energy=np.minimum(tables.energy, 1).reshape(shape),
        transmittance=transmittance(system, wavelengths_nm),
        point_flux=(tables.flux / area * middle_area / reference_area).reshape(shape))


def _source_tangent(system, view, nodes, wavelengths_nm):
    """Tangents of the light that lands at nodes, in the upright picture; linear beyond the end of the field: array
    (wavelength, node, 2)."""
    points = find_fields(system, view, nodes.inside_mm, wavelengths_nm)
    beyond = np.einsum("ijwn,jn->iwn", points.change, nodes.place_mm - nodes.inside_mm)
    return -np.moveaxis(points.tangent + beyond, 0, -1)


def _reference_area(system, view, quality: Quality):
    """Area in direction cosines of the bundle in the middle of the picture at the reference wavelength: the lens's
    f-number."""
    points = find_fields(system, view, np.zeros((2, 1)), [system.prescription.reference_wavelength_nm])
    traced = wavefronts_of(system, trace_fields(system, view, points, quality.full_pupil))
    return traced.areas(*quality.edges)[0][0, 0]
