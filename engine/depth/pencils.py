"""The rays of each pixel: even samples of the stop, seen from some distances from the axis."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..image.pixel_grid import FISHEYE, PixelGrid
from ..kernels import SEQUENCES, rays_shape

if TYPE_CHECKING:
    from ..bake.ray_table import RayTable

HEIGHTS = 65  # between which rays are interpolated linearly
MOST_BLADES = 64
LEAST_COSINE = 1e-3  # of rays to the axis: a depth along it tells no place beside the camera


@dataclass(frozen=True)
class Iris:
    """Blades that stop a lens down.

    Attributes
    ----------
    blades : int
        3 to MOST_BLADES; or 0, for a round stop.
    rotation_deg : float
        Of the first blade's middle, anticlockwise from the right, as the sensor sees it.
    roundness : float
        From 0, a polygon with its corners on the rim of the stop, to 1, a circle.
    """

    blades: int
    rotation_deg: float = 0.0
    roundness: float = 0.0

    def __post_init__(self) -> None:
        if self.blades and not 3 <= self.blades <= MOST_BLADES:
            raise InputError("iris", "blades", self.blades, f"expected 3 to {MOST_BLADES}, or 0 for a round stop")
        if not 0 <= self.roundness <= 1:
            raise InputError("iris", "roundness", self.roundness, "expected 0, straight blades, to 1, a circle")
        if not np.isfinite(self.rotation_deg):
            raise InputError("iris", "rotation", self.rotation_deg, "expected degrees")

    @property
    def directions(self) -> np.ndarray:
        """Those that the blades face: float32 array (blade, 2)."""
        azimuth = np.radians(self.rotation_deg) + 2 * np.pi * np.arange(self.blades) / max(self.blades, 1)
        return np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1).astype(np.float32)

    @property
    def shape(self) -> tuple[float, float, float]:
        """Margin, bend and slope: a place r passes where margin - bend r^2 - slope (r . direction) > 0 for all blades.

        That is a circle through two corners, of the radius 1 / roundness.
        """
        if not self.blades:
            return 1.0, 0.0, 0.0
        half, bend = np.pi / self.blades, self.roundness
        root = np.sqrt(1 - (bend * np.sin(half)) ** 2)
        return (float(np.cos(half) * root - bend * np.cos(2 * half) / 2), bend / 2,
                float(root - bend * np.cos(half)))


@dataclass(frozen=True, eq=False)
class Pencils:
    """Rays of pixels at even distances from the axis, outwards of which is up; of one sequence of them.

    Attributes
    ----------
    last_px : float
        The last of these distances.
    stop : float32 array (2, ray)
        Places of the stop, along the tangent and outwards, in semi-apertures.
    far_px, moved_px : float32 arrays (2, wavelength, height, ray)
        Outwards and along the tangent: where on the plane of an ideal image they go at infinity, in pixels; and how
        that moves with the inverse depth, in pixels times mm.
    margin, light : float32 arrays (wavelength, height, ray)
        Positive where they pass; and how much light they bring.
    """

    last_px: float
    stop: np.ndarray
    far_px: np.ndarray
    moved_px: np.ndarray
    margin: np.ndarray
    light: np.ndarray

    @property
    def heights(self) -> int:
        return self.margin.shape[1]

    @property
    def heights_per_px(self) -> float:
        return (self.heights - 1) / self.last_px

    def fringe_px(self, nearness: float) -> int:
        """How far apart the wavelengths of a ray go, at most, up to an inverse depth."""
        far, moved = (np.hypot(*(each[:, -1] - each[:, 0])) for each in (self.far_px, self.moved_px))
        return int(np.ceil(((far + nearness * moved) * (self.margin.max(axis=0) > 0)).max()))

    def packed(self) -> np.ndarray:
        """As the loops want them: array (height, eight, 2 + 6 wavelengths, 8), see `kernels.Casting.rays`."""
        rays = np.concatenate([self.far_px, self.moved_px, self.margin[None], self.light[None]])
        quantities, wavelengths, heights, count = rays.shape
        rays = rays.transpose(2, 1, 0, 3).reshape(heights, wavelengths * quantities, count)
        rays = np.concatenate([np.broadcast_to(self.stop, (heights, *self.stop.shape)), rays], axis=1)
        return rays.reshape(heights, -1, count // 8, 8).swapaxes(1, 2)


def pencils(rays: "RayTable", wavelengths_nm: np.ndarray, sensor: PixelGrid, focal_mm: float, count: int,
            sequence: int = 0) -> Pencils:
    """The rays of a sensor's pixels.

    Parameters
    ----------
    rays : RayTable
        Beyond its wavelengths its last ones are held.
    wavelengths_nm : array (wavelength,)
    sensor : PixelGrid
    focal_mm : float
        Of the capture that they look at.
    count : int
        Of rays, a power of two: that many of each sequence, and its first 2^n, lie evenly.
    sequence : int
        Of SEQUENCES.
    """
    pitch_mm = sensor.pitch_um * 1e-3
    last_px = min(sensor.farthest_px, rays.last_height_mm / pitch_mm)
    heights_mm = np.linspace(0, last_px * pitch_mm, HEIGHTS)
    stop = stop_places(count, sequence)
    found = rays.near(wavelengths_nm).bundles(heights_mm, -stop)  # as the light has them: upside down
    tangent = found.direction[:2] / np.maximum(found.direction[2], LEAST_COSINE)
    to_px = focal_mm / pitch_mm
    quantities = stop, tangent[::-1] * to_px, -found.entrance_mm[::-1] * to_px, found.margin, found.weight
    return Pencils(last_px, *(each.astype(np.float32) for each in quantities))


def packed_pencils(rays: "RayTable", wavelengths_nm: np.ndarray, sensor: PixelGrid, focal_mm: float,
                   count: int) -> tuple[np.ndarray, float]:
    """What the loops want of `pencils`: `kernels.Casting`'s rays and its heights per pixel."""
    packed = np.empty(rays_shape(HEIGHTS, count // 8, wavelengths_nm.size), np.float32)
    for sequence in range(SEQUENCES):  # one after another: what is made on the way is many times larger
        bundle = pencils(rays, wavelengths_nm, sensor, focal_mm, count, sequence)
        packed[:, sequence] = bundle.packed()
    return packed, bundle.heights_per_px


def per_focal(capture: PixelGrid, focal_mm: float) -> float:
    """What the loops know a fisheye capture by: one over its focal length in pixels; 0 of a plane one."""
    return capture.pitch_um * 1e-3 / focal_mm if capture.projection == FISHEYE else 0.0


def stop_places(count: int, seed: int) -> np.ndarray:
    """Places of the stop, each for as much of its area: array (2, count), in semi-apertures.

    Sobol's sequence with Owen's scrambling, by a hash (Burley, JCGT 9(4), 2020).
    """
    index = np.arange(count, dtype=np.uint32)
    first, second = _reversed(index), np.zeros_like(index)
    direction = 1 << 31
    for bit in range(count.bit_length()):
        second ^= np.where(index >> bit & 1, np.uint32(direction), np.uint32(0))
        direction ^= direction >> 1
    across, around = (_scrambled(bits, 2 * seed + axis) / 2.0**32 for axis, bits in enumerate((first, second)))
    radius, azimuth = np.sqrt(across), 2 * np.pi * around
    places = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)])
    ends = [0, *(2**n for n in range(5, count.bit_length()))]
    return np.concatenate([_gathered(places[:, first:end]) for first, end in zip(ends, ends[1:], strict=False)], axis=1)


def _gathered(places):
    """Places in an order in which those of an eight lie side by side: such rays mostly meet the same layers."""
    count = places.shape[1]
    if count <= 8:
        return places
    places = places[:, np.argsort(places[np.argmax(np.ptp(places, axis=1))], kind="stable")]
    return np.concatenate([_gathered(places[:, :count // 2]), _gathered(places[:, count // 2:])], axis=1)


def _reversed(bits):
    for shift, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF), (16, 0x0000FFFF)):
        mask = np.uint32(mask)
        bits = (bits >> np.uint32(shift)) & mask | (bits & mask) << np.uint32(shift)
    return bits


def _scrambled(bits, seed):
    bits = _reversed(bits) + np.uint32((seed + 1) * 0x9E3779B9 & 0xFFFFFFFF)
    for factor in (0x6C50B47C, 0xB82F1E52, 0xC7AFE638, 0x8D22F6E6):
        bits ^= bits * np.uint32(factor)
    return _reversed(bits)
