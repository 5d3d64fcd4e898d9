"""The ghost of an uncoated singlet against Mitsuba 3, whose particle tracer follows light through dielectric spheres.

    python validation/ghosts_against_mitsuba.py

Masks reduce two spheres to the surfaces of a biconvex lens, in a black mount behind a black stop. Collimated light
comes from the right and from below, so that stop and mount cut opposite sides of it, and the frame is not centred on
the axis. The light falls on a faintly scattering plane, and a pinhole camera in front of it takes the picture. Red,
green and blue keep different shares of the light at each reflection: one render separates light by its number of
reflections, so noise of the direct light does not affect the ghost.

Each figure is printed with its limit and with five standard errors of Mitsuba's noise, from ten seeds. The exit status
is 1 if a figure exceeds its limit. The render takes two processor minutes.
"""

import sys

import mitsuba
import numpy as np

from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.image.sources import Sources
from lensfield.engine.lens.iris import Iris, opening_within
from lensfield.engine.prescription.prescription import Prescription, Surface
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.rings import turned
from lensfield.engine.stray.ghosts import direct_light, ghosts

NM, INDEX = 587.5618, 2.0
FRONT_MM, BACK_MM, THICKNESS_MM, RIM_MM = 40.0, -60.0, 8.0, 4.8
STOP_MM, TO_LENS_MM = 4.0, 8.0  # the stop's semi-aperture, and its distance in front of the lens
DIRECTION = np.array([np.tan(np.radians(8.0)), np.tan(np.radians(-5.0)), 1.0])  # right, up, towards the scene
FRAME = PixelGrid((96, 144), 300.0, centre_px=(40.0, 80.0))
REGION_PX = 48
SEEDS, SAMPLES = range(10), 240  # photons of each seed, per pixel
SCATTERED = 1e-6  # by the plane: what returns to it from the lens is negligible
REMAINING = np.array([1.0, 0.0, 0.5])  # of light after a reflection, in red, green and blue
REFLECTIONS = np.array([0, 2, 4])
MOST_SEGMENTS = 14  # of a path with four reflections, from the lamp to the camera; holes count as surfaces
PLANE_MM, LAMP_MM = 1000.0, 20.0  # half width of the plane; distance of the lamp from the stop
CLEARANCE_MM = 0.05  # of the cylinder between the surfaces: more than the offset of Mitsuba's rays
SIGMAS = 5
LIMITS = {"light without reflection": 0.002, "light of the ghost": 0.01,
          "irradiance of six regions, over the frame's mean": 0.05}

mitsuba.set_variant("scalar_rgb")  # works without LLVM, and treats its three channels as numbers, not colours
To = mitsuba.ScalarTransform4f


def singlet():
    """The prescription, focused at infinity."""
    surfaces = (Surface(thickness_mm=TO_LENS_MM, stop=True),
                Surface(FRONT_MM, THICKNESS_MM, f"{INDEX}/1000000", RIM_MM), Surface(BACK_MM, semi_aperture_mm=RIM_MM))
    return turned(Prescription("singlet", surfaces, ("stop", STOP_MM), ("angle_deg", 15.0), focus="paraxial",
                               reference_wavelength_nm=NM, coating="none")).prescription


def by_lensfield(lens):
    """Light without reflection, in W nm^-1, and irradiance of the ghost, for an irradiance of 1 on the lens."""
    source = Sources(DIRECTION[None] / np.linalg.norm(DIRECTION), np.array([np.inf]), np.ones((1, 1)), np.array([NM]),
                     np.zeros(1), ("sun",))
    opening = opening_within(Iris(0), np.inf)
    found = ghosts(lens, source, FRAME, opening, share=0.0)
    return direct_light(lens, source, opening).item(), found.irradiance[0].astype(float)


def by_mitsuba(lens):
    """Irradiance by number of reflections, for each seed: array (seed, of REFLECTIONS, row, column)."""
    scene = mitsuba.load_dict(scene_of(system_of(lens).image_distance_mm))
    pictures = np.stack([np.array(mitsuba.render(scene, seed=seed), float) for seed in SEEDS])
    irradiance = pictures[:, :, ::-1] * np.pi / SCATTERED  # the camera sees the sensor's front: mirrored
    return np.einsum("rc,sijc->srij", np.linalg.inv(REMAINING[:, None] ** REFLECTIONS), irradiance)


def scene_of(to_sensor_mm):
    """Mitsuba's scene, in mm: x to the right and y up as the photographer sees it, z from the front vertex towards the
    sensor."""
    sensor_mm = THICKNESS_MM + to_sensor_mm
    front_mm, back_mm = sag_mm(FRONT_MM), THICKNESS_MM + sag_mm(BACK_MM)
    edge = {"type": "cylinder", "radius": RIM_MM, "p0": [0, 0, front_mm + CLEARANCE_MM],
            "p1": [0, 0, back_mm - CLEARANCE_MM], "bsdf": diffuse(0.0)}
    plane = To().translate([0, 0, sensor_mm]).rotate([1, 0, 0], 180).scale(PLANE_MM)
    return {"type": "scene", "integrator": {"type": "ptracer", "max_depth": MOST_SEGMENTS, "rr_depth": MOST_SEGMENTS},
            "lamp": lamp(), "stop": ring(-TO_LENS_MM, STOP_MM), "mount": ring(front_mm, RIM_MM), "edge": edge,
            "front": cap(0.0, FRONT_MM), "back": cap(THICKNESS_MM, BACK_MM),
            "plane": {"type": "rectangle", "to_world": plane, "bsdf": diffuse(SCATTERED)},
            "camera": camera(sensor_mm, 0.8 * to_sensor_mm)}


def sag_mm(radius_mm):
    """Of a surface's rim, from its vertex."""
    return radius_mm - np.sign(radius_mm) * np.sqrt(radius_mm**2 - RIM_MM**2)


def lamp():
    """A disc of collimated light that covers the stop."""
    right, up, away = LAMP_MM * DIRECTION
    look = To().look_at(origin=[right, up, -TO_LENS_MM - away], target=[0, 0, -TO_LENS_MM], up=[0, 1, 0])
    return {"type": "disk", "to_world": look @ To().scale(1.001 * STOP_MM), "bsdf": diffuse(0.0),
            "emitter": {"type": "directionalarea", "radiance": raw(1.0)}}


def ring(z_mm, hole_mm):
    """A black disc with a hole half as wide."""
    return {"type": "disk", "to_world": To().translate([0, 0, z_mm]).scale(2 * hole_mm),
            "bsdf": masked(diffuse(0.0), [[0.0, 1.0]])}


def cap(vertex_mm, radius_mm):
    """The part within the rim of a glass sphere, whose pole is the vertex."""
    glass = {"type": "dielectric", "int_ior": INDEX, "ext_ior": 1.0, "specular_reflectance": raw(*REMAINING)}
    pole = To().rotate([1, 0, 0], 180 if radius_mm > 0 else 0)
    share = np.arcsin(RIM_MM / abs(radius_mm)) / np.pi  # of the way from pole to pole
    middle = To().translate([0, 0, vertex_mm + radius_mm])
    return {"type": "sphere", "radius": abs(radius_mm), "to_world": middle @ pole,
            "bsdf": masked(glass, [[1.0], [0.0]], To().scale([1, 0.5 / share, 1]))}


def masked(bsdf, opacity, to_uv=None):
    """A surface with two halves of different opacity."""
    bitmap = mitsuba.Bitmap(np.array(opacity, np.float32)[..., None])
    texture = {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "nearest", "wrap_mode": "clamp",
               "to_uv": to_uv or To()}
    return {"type": "mask", "opacity": texture, "bsdf": bsdf}


def diffuse(reflectance):
    return {"type": "diffuse", "reflectance": raw(reflectance)}


def raw(*values):
    return {"type": "rgb", "value": [float(value) for value in np.resize(values, 3)]}


def camera(sensor_mm, away_mm):
    """A pinhole in front of the middle of the frame, upside down like the picture there."""
    left, lower, right, upper = FRAME.edges_mm
    x, y = -(left + right) / 2, -(lower + upper) / 2
    rows, columns = FRAME.shape_px
    look = To().look_at(origin=[x, y, sensor_mm - away_mm], target=[x, y, sensor_mm], up=[0, -1, 0])
    return {"type": "perspective", "to_world": look, "fov_axis": "x",
            "fov": float(2 * np.degrees(np.arctan((right - left) / 2 / away_mm))),
            "film": {"type": "hdrfilm", "width": columns, "height": rows, "pixel_format": "rgb",
                     "component_format": "float32", "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": SAMPLES}}


def region_means(pictures):
    """Means of the regions of pictures (..., row, column)."""
    rows, columns = (count // REGION_PX for count in FRAME.shape_px)
    return pictures.reshape(*pictures.shape[:-2], rows, REGION_PX, columns, REGION_PX).mean(axis=(-3, -1))


def met(what, limit, ours, theirs):
    """Print the largest difference of values from the mean of all seeds (seed, ...), over its average, with the noise
    and the limit; returns whether the limit is met."""
    truth = theirs.mean(axis=0)
    noise = theirs.std(axis=0, ddof=1) / np.sqrt(len(theirs))
    worst, noise = (np.max(np.abs(part)) / truth.mean() for part in (ours - truth, noise))
    print(f"{what}: {worst:.2%}, noise {SIGMAS * noise:.2%}, limit {limit:.1%}{'' if worst <= limit else '   MISSED'}")
    return worst <= limit


def main():
    """Compare the pictures, and return the exit status."""
    lens, pixel_m2 = singlet(), (FRAME.pitch_um * 1e-6)**2
    (light, ours), theirs = by_lensfield(lens), by_mitsuba(lens)
    direct, ghost, four = theirs.sum(axis=(2, 3)).T * pixel_m2
    print(f"\nThe ghost has {ghost.mean() / direct.mean():.2%} of the light without reflection; four reflections, not "
          f"compared, have {four.mean() / ghost.mean():.2%} of the ghost's")
    figures = (light, direct), (ours.sum() * pixel_m2, ghost), (region_means(ours), region_means(theirs[:, 1]))
    return int(not all([met(*limit, *figure) for limit, figure in zip(LIMITS.items(), figures, strict=True)]))


if __name__ == "__main__":
    sys.exit(main())
