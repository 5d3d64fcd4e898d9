"""Light: Cycles passes, summed into radiance at the requested wavelengths."""

from dataclasses import dataclass

import numpy as np

from lensfield.engine.image.detail import Detail, merged
from lensfield.engine.pictures.spectral_exr import read_parts
from lensfield.engine.runtime.errors import ImageError
from lensfield.engine.runtime.files import file_status, why_no_room
from lensfield.engine.runtime.scratch import new_array, release_memory
from lensfield.engine.spectral.control_variate import balance, block_means

from ..scene.errors import SceneError
from ..scene.units import depth_pass_m
from .bands import CHANNELS

ROWS_AT_ONCE = 16  # few enough to stay in the processor's cache
ROUNDING = 1e-5  # of a pixel's light: sums of its samples, and of its lamps, agree to a few millionths
MORE_BYTES = 1 << 20  # added to a truncated pass's size: a trial write of this much finds the cause
RIM_PX = 1  # margin around a slab's content


@dataclass(frozen=True, eq=False)
class PassLight:
    """The light of one Cycles pass.

    Attributes
    ----------
    cube : float32 array (lamp, channel, row, column)
        Channels as in CHANNELS; lamps as in the plan.
    alpha, depth_m : float32 arrays (row, column)
    guides : float32 array (plane, row, column)
        For the denoiser; no planes without one.
    detail : Detail or None
        Of the light of all lamps.
    """

    cube: np.ndarray
    alpha: np.ndarray
    depth_m: np.ndarray
    guides: np.ndarray
    detail: Detail | None = None

    @property
    def held(self):
        """Whether each pixel has content: array (row, column)."""
        return (self.alpha != 0) | self.cube.any(axis=(0, 1))

    def within(self, part):
        """The light of a part, given as slices of rows and columns."""
        return PassLight(*(plane[(..., *part)] for plane in (self.cube, self.alpha, self.depth_m, self.guides)),
                         self.detail and self.detail.within(*part))


class GatheredLight:
    """The radiance of one slab at the requested wavelengths, summed up pass by pass.

    Parameters
    ----------
    plan : ScenePlan
    layer_name : str
        Of the view layer.
    group_names : list of str
        Of the light groups.
    slab : Slab
    scratch : Path or None
        A folder for the radiance's scratch file; None for memory.
    unit_m : float
        Length of a Blender unit in metres.

    Attributes
    ----------
    slab : Slab
        If it narrows, the first pass limits its region to the part with content.
    cube : float32 array (wavelength, row, column)
        Of the region.
    alpha : float32 array (row, column)
        The mean over the passes, by their weights: a catcher of coloured shadows and tinted glass have another alpha at
        each wavelength.
    depth_m : float32 array (row, column)
        From the last pass.
    depth_plane : str
        The name of its plane.
    detail : Detail or None
        From the first pass.
    empty : bool
        Whether the first pass was empty.
    """

    def __init__(self, plan, layer_name, group_names, slab, scratch, unit_m):
        self.slab, self._plan, self._scratch, self._unit_m = slab, plan, scratch, unit_m
        self._light_passes = [f"{layer_name}.Combined", *(f"{layer_name}.Combined_{name}" for name in group_names)]
        self.depth_plane = depth_pass(layer_name)
        self.cube, self.alpha, self.depth_m, self.empty, self._blocks = None, None, None, False, {}
        self._alpha_weight = 0.0
        self.detail = None

    def is_spare(self, lights):
        """Whether it can be left out of `lights`, sorted from near to far: the first pass was empty, or a nearer slab
        hides it completely. At least one always remains."""
        return (self.empty and self is not lights[-1]) or any(
            nearer.covers(self.slab.region) for nearer in lights[:lights.index(self)])

    def covers(self, region):
        """Whether it is opaque all over a region of the capture."""
        part = place_in(self.slab.region, region)
        return self.alpha is not None and all(
            side.start >= 0 and side.stop <= n for side, n in zip(part, self.alpha.shape, strict=True)
        ) and bool(np.all(self.alpha[part] == 1))

    @property
    def planes(self):
        """Names of the planes that each of its passes must have: list of str; the first is alpha."""
        return [f"{self._light_passes[0]}.A", self.depth_plane,
                *(f"{name}.{channel}" for name in self._light_passes for channel in CHANNELS)]

    def light_of(self, planes, guides=()):
        """The PassLight of a pass, from its planes by name; `guides` are names for the denoiser."""
        alpha = planes[self.planes[0]]
        shape_px = tuple(part.stop - part.start for part in self.slab.region)
        if alpha.shape != shape_px:
            raise SceneError("Cycles", "render pass", "{1} x {0} px".format(*alpha.shape),
                             "expected {1} x {0} px".format(*shape_px))
        cube = np.array([[planes[f"{name}.{channel}"] for channel in CHANNELS] for name in self._light_passes])
        cube[0] = _without(cube[0], cube[1:].sum(axis=0))  # leaves the light outside Lensfield's groups
        return PassLight(cube, alpha, self.depth_of(planes),
                         np.array([planes[name] for name in guides]).reshape(-1, *shape_px))

    def depth_of(self, planes):
        """The depth in a pass, in metres, from its planes by name: float32 array (row, column)."""
        return depth_pass_m(planes[self.depth_plane], self._unit_m)

    def in_whole_pixels(self, planes, names, times):
        """Planes of whole pixels, by name, from planes of pixels that are divided into `times` x `times`: the mean, or
        the lower median of depths, because their mean may lie between two surfaces."""
        return {name: (_lower_median if name == self.depth_plane else _mean)(planes[name], times)
                for name in names}

    def picture(self, planes):
        """The light of all lamps in a pass, from its planes by name: array (channel, row, column)."""
        return np.array([planes[f"{self._light_passes[0]}.{channel}"] for channel in CHANNELS])

    def detail_of(self, index, picture, times):
        """The Detail of a pass, from the light of all lamps in pixels that are divided into `times` x `times`: array
        (channel, row, column)."""
        nm = self._plan.choice.nodes_nm[self._plan.nodes(index)]
        return Detail.of(picture[:nm.size], nm, times)

    def add(self, index, light, alpha_weight):
        """Add a pass's PassLight, store its depth, and include its alpha with a weight."""
        if self.cube is None:
            if self.slab.narrows:
                held = light.held
                around = _around(held)
                light = light.within(around)
                self.slab, self.empty = self.slab.within(around), not held.any()
            self.detail = light.detail
            self.cube = new_array((self._plan.choice.output_nm.size, *light.alpha.shape), self._scratch)
        self.depth_m = light.depth_m
        self._include(light.alpha, alpha_weight)
        mix = self._plan.mix(index)
        shares = (self._plan.shares(index) @ mix).astype(np.float32)
        channels = mix.shape[1]
        means = [block_means(plane) for plane in light.cube[:, :channels].sum(axis=0)]
        self._blocks |= zip(self._plan.nodes(index).tolist(), np.tensordot(mix, means, axes=1), strict=True)
        for row in range(0, self.cube.shape[1], ROWS_AT_ONCE):
            rows = slice(row, row + ROWS_AT_ONCE)
            self.cube[:, rows] += np.tensordot(shares, light.cube[:, :channels, rows], axes=2)
        release_memory(self.cube)

    def _include(self, alpha, weight):
        """Include a pass in the mean alpha, which keeps its bits where all passes have the same."""
        self._alpha_weight += weight
        if self.alpha is None or weight == self._alpha_weight:
            self.alpha = alpha
        else:
            self.alpha = self.alpha + np.float32(weight / self._alpha_weight) * (alpha - self.alpha)

    def radiance(self):
        """The sum of all passes: array (wavelength, row, column), without negative estimates."""
        for plane in self.cube:
            balance(plane)
        return self.cube

    def blocks(self):
        """Means over blocks of pixels, at the rendered wavelengths: array (node, block)."""
        return np.array([self._blocks[node].ravel() for node in sorted(self._blocks)])


def _without(light, part):
    """The light without a part of it; 0 if only rounding remains, whose colour is arbitrary."""
    rest = light - part
    rest[np.abs(rest) < ROUNDING * np.abs(light)] = 0
    return rest


def place_in(outer, region):
    """A region of the capture as slices of the planes of another one."""
    return tuple(slice(side.start - start.start, side.stop - start.start)
                 for start, side in zip(outer, region, strict=True))


def read_pass(path, needed):
    """The planes of a pass by name; a SceneError if one of `needed` is missing."""
    try:
        planes = {name: plane for _, channels in read_parts(path) for name, plane in channels.items()}
    except ImageError:  # truncated, or missing
        planes = {}
    if not planes.keys() >= set(needed):
        status = file_status(path)
        why = why_no_room(path.parent, (status.st_size if status else 0) + MORE_BYTES)
        raise SceneError(path, "render pass", "incomplete", why or "see Blender's messages above")
    return planes


def _mean(plane, times):
    return merged(plane[None], times)[0]


def _lower_median(plane, times):
    rows, columns = plane.shape
    parts = plane.reshape(rows // times, times, columns // times, times).swapaxes(1, 2)
    return np.sort(parts.reshape(rows // times, columns // times, -1))[..., (times**2 - 1) // 2]


def depth_pass(layer_name):
    """The name of the plane with a view layer's depth."""
    return f"{layer_name}.Depth.Z"


def _around(held):
    """Rows and columns of all true pixels, with a margin; a single pixel if none is true."""
    sides = []
    for axis in (1, 0):
        places = np.flatnonzero(held.any(axis=axis))
        sides.append(slice(max(places[0] - RIM_PX, 0), places[-1] + 1 + RIM_PX) if places.size else slice(0, 1))
    return tuple(slice(side.start, min(side.stop, n)) for side, n in zip(sides, held.shape, strict=True))
