"""A lens in the order in which rays from the sensor meet it, at one wavelength, for a camera that traces these rays.

A ray starts anywhere in its pixel and aims at a rectangle on the plane of the rear vertex, which encloses the part of
the exit pupil that is visible from the pixel. The irradiance of the sensor, the integral of L cos(t) dw, is an integral
of L cos^4(t) / z^2 dA over that plane, at the distance z.
"""

from dataclasses import dataclass

import numpy as np

from ..prescription.prescription import Prescription
from .fields import view_of
from .focus import build_system
from .sensor_aim import Bins, Cells, aim_bins, aim_cells
from .trace import traced_surfaces
from .transmission import coating_transmittance

TURNED = np.diag([1.0, 1.0, -1.0, 1.0])  # from z along the light to z towards the scene


@dataclass(frozen=True, eq=False)
class FromSensor:
    """Surfaces in the order in which rays from the sensor meet them; z points from each vertex towards the scene.

    Attributes
    ----------
    gap_mm : array (surface,)
        Distance to this vertex from the previous one, or from the sensor; negative between two mirrors.
    curvature_per_mm, conic : arrays (surface,)
    terms : array (surface, term)
        Coefficients of the powers `first_power`, `first_power + power_step`, ... of the distance from the axis, in mm.
    first_power, power_step : int
    semi_aperture_mm : array (surface,)
        Including the stop; inf if unlimited.
    half_widths_mm : array (surface, 2) or None
        Of rectangular apertures, along x and y; inf without one. None if no surface has one.
    semi_obstruction_mm : array (surface,)
        0 without a central obstruction.
    index_ratio : array (surface,)
        Index in front of a surface over the index behind it, along these rays; negative for a mirror, as in `System`.
    absorption_per_mm : array (surface,)
        Absorption of the medium in front of a surface, along these rays.
    coating_transmittance : float
        As of `transmission.coating_transmittance`, for all rays.
    entrance_pupil_mm : float
        From the last of these surfaces to the entrance pupil, away from the scene.
    aim : Bins or Cells
    origin_mm : array (2,)
        Origin on the sensor of positions on the film, which are the negatives of positions on the sensor.
    sections : Sections or None
        None if all surfaces are of revolution.
    poses : Poses or None
        None if all surfaces and the sensor are on the axis.
    """

    gap_mm: np.ndarray
    curvature_per_mm: np.ndarray
    conic: np.ndarray
    terms: np.ndarray
    first_power: int
    power_step: int
    semi_aperture_mm: np.ndarray
    semi_obstruction_mm: np.ndarray
    index_ratio: np.ndarray
    absorption_per_mm: np.ndarray
    coating_transmittance: float
    entrance_pupil_mm: float
    aim: Bins | Cells
    origin_mm: np.ndarray
    sections: "Sections | None" = None
    poses: "Poses | None" = None
    half_widths_mm: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Sections:
    """Surfaces whose sections along x and y differ.

    Attributes
    ----------
    kinds : array (surface,)
        0, or one of `KINDS`.
    along_x : array (surface, 2 + even_terms)
        As `TracedSurfaces.sections`.
    """

    kinds: np.ndarray
    along_x: np.ndarray


@dataclass(frozen=True, eq=False)
class Poses:
    """Frames of displaced surfaces, as matrices of affine maps of columns.

    Attributes
    ----------
    to_surface : array (surface, 4, 4)
        From the frame of the surface before, or of the sensor, to the frame of this surface.
    to_camera : array (4, 4)
        From the frame of the last surface to the frame of the camera.
    """

    to_surface: np.ndarray
    to_camera: np.ndarray


def lens_from_sensor(prescription: Prescription, wavelength_nm: float, edges_mm: tuple[float, float, float, float]
                     ) -> FromSensor:
    """Prepare a lens for rays from its sensor.

    Parameters
    ----------
    prescription : Prescription
        At its ring settings.
    wavelength_nm : float
    edges_mm : (float, float, float, float)
        Left, lower, right and upper edge of the film in the upright picture, from the middle of the lens's view.

    Raises
    ------
    LensError
        A prescription that cannot be traced, or a wavelength at which the index of a glass is unknown.
    """
    system = build_system(prescription)
    prescription, view = system.prescription, view_of(system)
    surfaces, indices = prescription.surfaces[::-1], system.indices_at([wavelength_nm])[:, 0]
    extinction = np.array([glass.extinction_at([wavelength_nm])[0] for glass in system.glasses])[::-1]
    sections = _sections(prescription)
    terms, first_power, power_step = _terms(surfaces, least=0 if sections is None else 1)
    if prescription.radial:
        left, lower, right, upper = edges_mm
        aim: Bins | Cells = aim_bins(system, indices, float(np.hypot(max(-left, right), max(-lower, upper))))
    else:
        aim = aim_cells(system, view, indices, edges_mm)
    return FromSensor(
        gap_mm=np.array([surface.thickness_mm for surface in surfaces]),
        curvature_per_mm=np.array([-1 / surface.radius_mm for surface in surfaces]),
        conic=np.array([surface.conic for surface in surfaces]),
        terms=terms, first_power=first_power, power_step=power_step,
        semi_aperture_mm=system.all_semi_apertures_mm[::-1],
        semi_obstruction_mm=np.array([surface.semi_obstruction_mm for surface in surfaces]),
        index_ratio=(indices[1:] / indices[:-1])[::-1],
        absorption_per_mm=4 * np.pi * extinction / (wavelength_nm * 1e-6),
        coating_transmittance=float(coating_transmittance(system, [wavelength_nm])[0]),
        entrance_pupil_mm=system.entrance_pupil_mm, aim=aim, origin_mm=view.origin_mm, sections=sections,
        poses=_poses(prescription, view), half_widths_mm=_half_widths_mm(surfaces))


def _half_widths_mm(surfaces):
    if all(not surface.half_widths_mm for surface in surfaces):
        return None
    return np.array([surface.half_widths_mm or (np.inf, np.inf) for surface in surfaces])


def _sections(prescription):
    traced = traced_surfaces(prescription)
    if traced.kinds is None:
        return None
    return Sections(traced.kinds[::-1], traced.sections[::-1] * [-1, *[1] * (traced.sections.shape[1] - 1)])


def _poses(prescription, view):
    poses = traced_surfaces(prescription).poses
    if poses is None:
        return None
    frames = [_affine(pose[3:].reshape(3, 3), pose[:3]) for pose in poses[::-1]]  # the frame of the sensor is the first
    steps_mm = [surface.thickness_mm for surface in prescription.surfaces[::-1]]
    to_surface = [np.linalg.inv(frame) @ _affine(np.eye(3), (0, 0, step_mm)) @ before
                  for before, frame, step_mm in zip(frames, frames[1:], steps_mm, strict=False)]
    to_camera = _affine(view.axes, -view.axes @ view.viewpoint_mm) @ frames[-1]
    return Poses(*(TURNED @ each @ TURNED for each in (np.stack(to_surface), to_camera)))


def _affine(matrix, offset_mm):
    return np.block([[matrix, np.reshape(offset_mm, (3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])


def _terms(surfaces, least):
    """Coefficients for the reversed z axis, at least as many as this; their first power and its step."""
    if any(surface.odd_aspheric for surface in surfaces):
        count = max(max(2 * len(surface.aspheric), 2 * len(surface.odd_aspheric) - 1) for surface in surfaces)
        terms = np.zeros((len(surfaces), count))
        for row, surface in zip(terms, surfaces, strict=True):
            row[1:2 * len(surface.aspheric):2] = surface.aspheric
            row[:2 * len(surface.odd_aspheric):2] = surface.odd_aspheric
        return -terms, 1, 1
    count = max(least, *(len(surface.aspheric) for surface in surfaces))
    return -np.array([[*surface.aspheric, *(0.0,) * (count - len(surface.aspheric))] for surface in surfaces]), 2, 2
