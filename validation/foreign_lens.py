"""A lens that Optiland reads, focuses and traces, without any module of Lensfield.

Reader, glass data, entrance pupil and stop are Optiland's. Two values that its readers ignore are read here: the unit
of length, and Code V's defocus.
"""

import warnings
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
from optiland.fileio import load_codev_file, load_zemax_file
from optiland.rays import RealRays
from scipy.stats import qmc

MM = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "METER": 1e3, "M": 1.0, "C": 10.0, "I": 25.4}
UNIT_WORDS = "UNIT", "DIM"
CHIEF_STEPS, CHIEF_OFF = 12, 1e-6  # to the middle of the stop, in its radii
WITHIN = 0.98  # of that disc: rays that pass must stay within this radius


class ForeignLens:
    """A lens at a wavelength, from a .zmx or .seq.

    Parameters
    ----------
    path : path
    wavelength_nm : float
    focus_mm : float, optional
        Distance of the object from the entrance pupil. The image plane moves with the paraxial image, by Newton's
        equation; by default it is the file's.
    stop_mm : float, optional
        Semi-diameter of the stop; by default the height of Optiland's paraxial marginal ray.

    Attributes
    ----------
    efl_mm, entrance_pupil_mm, entrance_pupil_radius_mm : float
        Focal length; position, from the first surface, and size of the entrance pupil.
    squeeze : float
        Width over height of the scene behind a square pixel.
    aim : float
        Radius of the disc that rays aim at, in entrance pupil radii: pupils of oblique bundles are larger.
    """

    squeeze, aim = 1.0, 1.7

    def __init__(self, path, wavelength_nm, focus_mm=None, stop_mm=None):
        load = load_codev_file if Path(path).suffix.lower() == ".seq" else load_zemax_file
        with warnings.catch_warnings(), redirect_stdout(StringIO()):  # about vignetting factors, which are unused here
            warnings.simplefilter("ignore")
            self._optic = load(str(path))
        self._mm, self._um = unit_mm(Path(path)), wavelength_nm * 1e-3
        self._surfaces = self._optic.surfaces
        stop_index = self._surfaces.stop_index
        self._stop = self._surfaces.surfaces[stop_index]
        paraxial = self._optic.paraxial
        self.efl_mm = float(np.ravel(paraxial.f2())[0]) * self._mm
        self.entrance_pupil_mm = float(np.ravel(paraxial.EPL())[0]) * self._mm
        self.entrance_pupil_radius_mm = float(np.ravel(paraxial.EPD())[0]) * self._mm / 2
        image = self._surfaces.surfaces[-1].geometry.cs
        image.z += defocus(Path(path))
        if focus_mm is not None:
            before_focal_point_mm = focus_mm - self.entrance_pupil_mm + float(paraxial.F1()) * self._mm
            image.z += self.efl_mm**2 / before_focal_point_mm / self._mm
        marginal = abs(float(np.ravel(paraxial.marginal_ray()[0][stop_index])[0]))
        self._stop_radius = marginal if stop_mm is None else stop_mm / self._mm

    def lamp(self, place_mm, half_mm, depth_mm, blocked=None, rays=2**15, seed=0):
        """Light of a flat square or rectangular lamp that faces the camera.

        Parameters
        ----------
        place_mm : (float, float)
            Its middle, to the right and up in the camera's view.
        half_mm : float or (float, float)
            Half its side, or half its width and height.
        depth_mm : float
            From the entrance pupil.
        blocked : function (place_at), optional
            The rays that a nearer object blocks, as a bool array; `place_at(depth_mm)` returns their x and y there.

        Returns
        -------
        array (2, ray)
            Points on the sensor: x and y in the upright picture, in mm.
        array (ray,)
            Their light for unit radiance, in mm^2 sr.
        """
        sample = qmc.Sobol(4, seed=seed).random(rays).T
        start = np.reshape(place_mm, (2, 1)) + np.reshape(half_mm, (-1, 1)) * (2 * sample[:2] - 1)
        aim_mm = self.aim * self.entrance_pupil_radius_mm
        aim = aim_mm * np.sqrt(sample[2]) * np.array([np.cos(2 * np.pi * sample[3]), np.sin(2 * np.pi * sample[3])])
        way = np.stack([*(aim - start), np.full(rays, depth_mm)])
        direction = way / np.linalg.norm(way, axis=0)
        landed, passing = self._traced(aim, direction)
        if np.any(np.hypot(*aim)[passing] > WITHIN * aim_mm):
            raise ValueError("rays pass at the edge of the sampled disc: raise aim")
        if blocked is not None:
            passing &= ~blocked(lambda at_mm: start + (aim - start) * (1 - at_mm / depth_mm))
        light = direction[2]**4 / depth_mm**2 * np.prod(2 * np.broadcast_to(half_mm, 2)) * np.pi * aim_mm**2 / rays
        return -landed[:, passing], light[passing]

    def chief_mm(self, place_mm, depth_mm):
        """Sensor point of the ray from a point through the middle of the stop, in the upright picture: array (2,)."""
        place_mm, aim_mm = np.array(place_mm, dtype=float), np.zeros(2)
        for _ in range(CHIEF_STEPS):  # the position in the stop is nearly proportional to the aim
            way = np.array([*(aim_mm - place_mm), depth_mm])
            landed_mm, _ = self._traced(aim_mm[:, None], (way / np.linalg.norm(way))[:, None])
            off = np.array([self._stop.x[0], self._stop.y[0]]) / self._stop_radius
            aim_mm = aim_mm - off * self.entrance_pupil_radius_mm
        if np.hypot(*off) > CHIEF_OFF:
            raise ValueError("the ray through the middle of the stop was not found")
        return -landed_mm[:, 0]

    def _traced(self, aim_mm, direction):
        """Sensor points of rays through points in the plane of the entrance pupil, and a mask of those that pass."""
        before = self.entrance_pupil_mm + 2 * self.entrance_pupil_radius_mm  # from a plane in front of all surfaces
        place = (aim_mm - direction[:2] / direction[2] * before) / self._mm
        count = direction.shape[1]
        start_z = np.full(count, (self.entrance_pupil_mm - before) / self._mm)
        rays = RealRays(*place, start_z, *direction, np.ones(count), np.full(count, self._um))
        with np.errstate(invalid="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self._surfaces.trace(rays, skip=1)
            at_stop = np.hypot(self._stop.x, self._stop.y)
            passing = np.isfinite(rays.x) & (rays.i > 0) & (at_stop <= self._stop_radius)
        return np.array([rays.x, rays.y]) * self._mm, passing


def unit_mm(path):
    """A file's unit of length in millimetres, from its UNIT or DIM line; 1 without such a line."""
    return next((MM[words[1]] for words in words_of(path) if words[0] in UNIT_WORDS), 1.0)


def defocus(path):
    """Code V's shift of the image plane, in the file's unit: the thickness of its image surface, which Optiland does
    not use. 0 for a .zmx."""
    lines = words_of(path) if path.suffix.lower() == ".seq" else ()
    return next((float(words[2]) for words in lines if words[0] == "SI"), 0.0)


def words_of(path):
    """The words of each line that has at least two."""
    text = path.read_bytes()
    text = text.decode("utf-16" if text[:2] in (b"\xff\xfe", b"\xfe\xff") else "latin-1")
    return [words for line in text.splitlines() if len(words := line.split()) > 1]
