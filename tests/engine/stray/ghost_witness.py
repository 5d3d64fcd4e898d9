"""Ghosts by batoid, which splits rays at every surface: the landing point and the flux of each path.

    .venv-bake/bin/python -W ignore tests/engine/stray/ghost_witness.py

prints the differences that docs/stray_light.md states. Each surface has another constant reflectance, because batoid's
coatings depend on neither angle nor index. The reflectances of bare glass are Fresnel's, at batoid's own angles.
Refractive indices and the absorption of glass are the engine's.
"""

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import batoid
import numpy as np

from fresnel import fresnel
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.sources import Sources
from lensfield.engine.kernels.ghost_meshes import LIGHT
from lensfield.engine.kernels.ghosts import Beam
from lensfield.engine.lens.iris import Iris, opening_within
from lensfield.engine.library import prescription_of
from lensfield.engine.prescription.coatings import Coating, MeasuredReflectance
from lensfield.engine.prescription.prescription import Pose
from lensfield.engine.prescription.system import system_of
from lensfield.engine.prescription.tolerances import Copy
from lensfield.engine.rays.fields import view_of
from lensfield.engine.rays.rings import Rings, turned
from lensfield.engine.stray.ghost_bands import sample_of
from lensfield.engine.stray.ghost_beams import INVARIANT_STEPS, coatings_of, ghost_lens
from lensfield.engine.stray.ghost_rays import boxes_of, trace_ghosts
from lensfield.engine.stray.ghost_survey import open_square
from lensfield.engine.stray.ghosts import ghosts

NM = 550.0
MM = 1e-3  # in batoid's metres
FIRST_SHARE, STEP_SHARE = 0.02, 0.005  # reflectances of the surfaces
LEAST_FLUX = 3e-5  # above that of all paths with four reflections, and below that with two
WIDE = 1.3  # of the first semi-aperture, for oblique light
FEW, MANY = 25, 241  # rays across
BRIGHT = 0.02  # share of all light
FRAME_PX, FRAME_EFL = 1500, 6.0  # the square frame for sums, in focal lengths


class Case(NamedTuple):
    """A lens of the library and a lamp."""

    name: str
    rings: Rings
    right_deg: float
    up_deg: float
    distance_mm: float = np.inf
    size: float = 1.0


CASES = {
    "triplet": Case("cooke-triplet-50mm", Rings(f_number=5.6), 8.0, 5.0),
    "double Gauss": Case("zeiss-biotar-50mm", Rings(f_number=2.8), 9.0, -4.0),
    "double Gauss, a tenth as large": Case("zeiss-biotar-50mm", Rings(f_number=2.8), -6.0, 7.0, size=0.1),
    "triplet, lamp at 300 mm": Case("cooke-triplet-50mm", Rings(f_number=5.6), -7.0, 6.0, 300.0),
    "double Gauss, dropped copy, tilted sensor": Case("zeiss-biotar-50mm", Rings(
        f_number=4.0, tilt_deg=(2.0, -1.0), copy=Copy(28, "dropped")), 7.0, 4.0)}


class RayDifference(NamedTuple):
    """Numbers of rays that both programs let pass, that one does, and that are close to total reflection; and the
    largest differences of landing points, and of fluxes of other rays with constant reflectances and of bare glass."""

    rays: int
    disputed: int
    nearly_total: int
    place_mm: float
    flux: float
    bare_flux: float


class SumDifference(NamedTuple):
    """Differences of ghosts' light: of the brightest ones and of all, as shares, and of its centre in frames."""

    bright: float
    total: float
    centre: float


def lens_of(case, bare=False):
    """The prescription of a case, with constant reflectances or none, which is bare glass."""
    lens = prescription_of(case.name).scaled(case.size)
    shares = FIRST_SHARE + STEP_SHARE * np.arange(len(lens.surfaces))
    coatings = tuple(Coating(f"constant {share:.3f}", measured=MeasuredReflectance((300.0, 900.0), (0.0,), (
        (share,), (share,)))) for share in shares.tolist())
    fronts = ("", *(surface.glass for surface in lens.surfaces))
    surfaces = tuple(replace(surface, coating="none" if bare or surface.glass == front else coating.name)
                     for front, surface, coating in zip(fronts, lens.surfaces, coatings, strict=False))
    return turned(replace(lens, surfaces=surfaces, coatings=coatings, coating="none"), case.rings).prescription


def sources_of(case, irradiance=1.0):
    direction = np.array([np.tan(np.radians(case.right_deg)), np.tan(np.radians(case.up_deg)), 1.0])
    return Sources(direction[None] / np.linalg.norm(direction), np.array([case.distance_mm]),
                   np.array([[irradiance]]), np.array([NM]), np.zeros(1), ("lamp",))


def optic_of(lens):
    """batoid's lens. Surfaces have their numbers from 0 as names, and rims, as the stop has."""
    system = system_of(lens)
    indices, rims_mm = system.indices_at([NM])[:, 0], system.semi_apertures_mm
    rims_mm[lens.stop_index] = system.stop_semi_aperture_mm
    shares = system.reflectances([NM], [0.0])[:, 0, 0]
    media = [batoid.ConstMedium(index) for index in indices]
    surfaces, along_mm = [], 0.0
    for number, surface in enumerate(lens.surfaces):
        shape = batoid.Plane() if np.isinf(surface.radius_mm) else batoid.Quadric(surface.radius_mm * MM, surface.conic)
        rim = batoid.ObscNegation(batoid.ObscCircle(rims_mm[number] * MM))
        interface = batoid.RefractiveInterface(shape, rim, name=str(number), coordSys=place(surface.pose, along_mm),
                                               inMedium=media[number], outMedium=media[number + 1])
        interface.forwardCoating = interface.reverseCoating = batoid.SimpleCoating(shares[number], 1 - shares[number])
        surfaces.append(interface)
        along_mm += surface.thickness_mm
    return batoid.CompoundOptic(surfaces), place(lens.image_pose, along_mm)


def place(pose, along_mm):
    pose = pose or Pose()
    return batoid.CoordSys((np.array([0.0, 0.0, along_mm]) + pose.offset_mm) * MM, pose.rotation)


def lamp_rays(beam, across_mm, up_mm):
    """Rays through places of a beam's cross section, with the part of the irradiance on it as flux."""
    start = beam.axes[:2].T @ np.stack([across_mm, up_mm])
    along = np.repeat(beam.axes[2][:, None], start.shape[1], axis=1)
    flux = np.ones(start.shape[1])
    if np.isfinite(beam.distance_mm):
        away = start - beam.source_mm[:, None]
        length = np.linalg.norm(away, axis=0)
        flux, along = beam.distance_mm**2 / length**2 * (beam.axes[2] @ away) / length, away / length
    start = (start - 20 * np.abs(start).max() * along) * MM  # in front of the first surface
    return batoid.RayVector(*start, *along, np.zeros(flux.size), 1e-9 * np.arange(flux.size), flux)


def split(optic, plane, rays):
    """Landing points in mm and fluxes of rays, by batoid: array (3, ray) for each path, NaN for lost rays."""
    found, _ = optic.traceSplit(rays.copy(), minFlux=LEAST_FLUX)
    landed = {}
    for each in found:
        batoid.Plane().intersect(each, coordSys=plane)
        values = landed[tuple(map(int, each.path))] = np.full((3, len(rays)), np.nan)
        values[:, np.rint(each.wavelength * 1e9).astype(int)] = each.x / MM, each.y / MM, each.flux
    return landed


def path_of(pair, count):
    """The surfaces that light meets which a pair of surfaces reflects, or none if it is -1."""
    near, far = pair
    return tuple(range(count)) if far < 0 else (*range(far + 1), *range(far - 1, near - 1, -1), *range(near + 1, count))


def bare_flux(optic, rays, path):
    """What Fresnel's equations leave of rays' light along a path, with batoid's directions and normals; and the least
    difference of (n sin(angle))^2 from that of total reflection."""
    flux, margin, heading = rays.flux.copy(), np.full(len(rays), np.inf), 1
    for here, ahead in zip(path, (*path[1:], len(optic.items)), strict=True):
        interface = optic.items[here]
        media = (interface.inMedium, interface.outMedium)[::heading]
        at = interface.intersect(rays.copy())  # a second intersection at the same place could fail
        cosine = np.abs(np.sum(at.v * interface.surface.normal(at.x, at.y), axis=1)) / np.linalg.norm(at.v, axis=1)
        before, behind = (medium.getN(NM * 1e-9) for medium in media)
        margin = np.fmin(margin, min(before, behind)**2 - before**2 * (1 - cosine**2))
        share = fresnel(before, behind, cosine)
        if ahead - here == heading:
            interface.surface.refract(rays, *media, coordSys=interface.coordSys)
            flux *= 1 - share
        else:
            interface.surface.reflect(rays, coordSys=interface.coordSys)
            flux *= share
            heading = -heading
    return flux, margin


def beam_of_lamp(system, case):
    view, direction = view_of(system), sources_of(case).directions[0]
    along, source_mm = view.axes.T @ direction, np.full(3, np.inf)
    if np.isfinite(case.distance_mm):
        source_mm = view.viewpoint_mm - case.distance_mm * along
        along = -source_mm / np.linalg.norm(source_mm)
    across = np.cross([0.0, 1.0, 0.0], along)
    across /= np.linalg.norm(across)
    return Beam(np.stack([across, np.cross(along, across), along]), source_mm, case.distance_mm)


def opened(system):
    return ghost_lens(system, opening_within(Iris(0), np.inf), np.array([NM]))


def coated(lens):
    return coatings_of(lens.system, (NM,)).of(sample_of(np.array([NM])))


def compared_rays(case):
    """Differences ray by ray, of all pairs and of light that is not reflected."""
    lens, bare = (opened(system_of(lens_of(case, bare))) for bare in (False, True))
    optic, plane = optic_of(lens.system.prescription)
    beam, pairs = beam_of_lamp(lens.system, case), np.vstack([lens.pairs, [[-1, -1]]])
    limits_mm = WIDE / lens.openings.per_semi_aperture[0] * np.tile([-1.0, 1.0, -1.0, 1.0], (len(pairs), 1))
    ours, ours_bare = (trace_ghosts(each, coated(each), beam, pairs, limits_mm, FEW)
                       for each in (lens, bare))
    rays = lamp_rays(beam, *rays_within(lens, limits_mm))
    paths = [path_of(pair, len(optic.items)) for pair in pairs]
    found, lost = split(optic, plane, rays), np.full((3, len(rays)), np.nan)
    assert set(found) <= set(paths)
    theirs = np.stack([found.get(path, lost) for path in paths])
    fluxes, margins = np.moveaxis([bare_flux(optic, rays.copy(), path) for path in paths], 1, 0)
    passes = (open_square(lens, ours) <= 1).reshape(fluxes.shape)
    ours, ours_bare = (each.reshape(*each.shape[:2], -1) for each in (ours, ours_bare))
    arrives = np.isfinite(theirs).all(axis=1)
    both, sure = passes & arrives, passes & arrives & (margins > 1 / INVARIANT_STEPS)
    apart_mm = ours[:, :2] - (theirs[:, :2] - view_of(lens.system).origin_mm[:, None])
    return RayDifference(int(both.sum()), int((passes != arrives).sum()), int((both & ~sure).sum()),
                         np.hypot(*np.moveaxis(apart_mm, 1, 0))[both].max(),
                         np.abs(ours[:, LIGHT] / theirs[:, 2] - 1)[sure].max(),
                         np.abs(ours_bare[:, LIGHT] / fluxes - 1)[sure].max())


def rays_within(lens, limits_mm):
    """Places across and up of the rays of `trace_ghosts`."""
    boxes, shape = boxes_of(lens, limits_mm, FEW)
    up, across = np.indices(shape).reshape(2, -1)
    return boxes[0, 0] + across * boxes[0, 1], boxes[0, 2] + up * boxes[0, 3]


def compared_sums(case):
    """Differences of the light of ghosts on a wide frame."""
    lens = lens_of(case)
    system = system_of(lens)
    optic, plane = optic_of(lens)
    width_mm, half_mm = FRAME_EFL * system.efl_mm, WIDE * system.semi_apertures_mm[0]
    frame = PixelGrid((FRAME_PX, FRAME_PX), 1e3 * width_mm / FRAME_PX)
    found = ghosts(lens, sources_of(case), frame, opening_within(Iris(0), np.inf), share=0.0)
    steps_mm, step_mm = np.linspace(-half_mm, half_mm, MANY, retstep=True)
    across_mm, up_mm = (each.ravel() for each in np.meshgrid(steps_mm, steps_mm))
    landed = split(optic, plane, lamp_rays(beam_of_lamp(system, case), across_mm, up_mm))
    light, moment_mm = np.zeros(len(found.pairs)), np.zeros(2)
    for number, path in enumerate(path_of(pair, len(optic.items)) for pair in found.pairs - 1):
        if path in landed:
            places_mm = np.nan_to_num(landed[path][:2] - view_of(system).origin_mm[:, None], nan=np.inf)
            inside = (np.abs(places_mm) < width_mm / 2).all(axis=0)
            weights = landed[path][2, inside] * glass_share(system, path) * step_mm**2 * 1e-6
            light[number], moment_mm = weights.sum(), moment_mm + places_mm[:, inside] @ weights
    ours, bright = np.nan_to_num(found.light[0, :, 0]), light > BRIGHT * light.sum()
    return SumDifference(np.abs(ours[bright] / light[bright] - 1).max(), abs(ours.sum() / light.sum() - 1),
                         np.abs(centre_mm(found, frame) - moment_mm / light.sum()).max() / width_mm)


def centre_mm(found, frame):
    picture, (x_mm, y_mm) = found.irradiance[0].astype(float), frame.axes_mm()
    return np.array([picture.sum(axis=0) @ x_mm, picture.sum(axis=1) @ y_mm]) / picture.sum()


def glass_share(system, path):
    """What the glass along the axis does not absorb of the light of a path."""
    gaps = [min(here, ahead) for here, ahead in pairwise(path)]
    return np.exp(-sum(4 * np.pi * system.glasses[gap].extinction_at(np.array([NM]))[0]
                       * system.prescription.surfaces[gap].thickness_mm / (NM * 1e-6) for gap in gaps))


def main():
    print("| lens | rays (disputed, nearly total) | landing points, mm | fluxes | fluxes, bare glass | bright ghosts | "
          "all ghosts | centre |")
    print(8 * "|---" + "|")
    for name, case in CASES.items():
        rays, sums = compared_rays(case), compared_sums(case)
        counts = f"{rays.rays} ({rays.disputed}, {rays.nearly_total})"
        print(f"| {name} | {counts} | {rays.place_mm:.0e} | {rays.flux:.0e} | {rays.bare_flux:.0e} | "
              f"{100 * sums.bright:.1f} % | {100 * sums.total:.2f} % | {100 * sums.centre:.2f} % |")


if __name__ == "__main__":
    main()
