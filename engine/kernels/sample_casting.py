"""A small casting that uses every part of the loop, by which a graphics processor is compared with C."""

import numpy as np

from .casting import MEETING, QUANTITIES, STOP, Casting, HeightRays, LayerArrays, MeshRays
from .levels import LayerPlanes, LevelKind, Nearer

TILES, TILE_PX, STEPS = (2, 3), 16, (1, 2, 4, 1, 5, 2)
LAYER_PX, AXIS_PX = (52, 66), (23.3, 28.9)
CAPTURE_PX, ORIGINS_PX = (57, 69), ((2, 3), (5, 0))
KINDS = (LevelKind(4, 5, 0.0),), (LevelKind(2, 2, 0.5),)
CENTRE_PX = 13.4, 21.7
INVERSE_DEPTHS = 0.02, 0.002
BLUR_PX = 150.0  # of a ray at the rim of the stop, for an inverse depth of 1
FINER = 3  # steps of the chief rays' mesh in a step of the rays' mesh


def sample_casting(wavelengths: int, mesh: bool) -> Casting:
    """A casting by rays of heights, with an iris, or of a mirrored mesh, in a panorama."""
    rays = _mesh_rays(wavelengths) if mesh else _height_rays(wavelengths)
    blades = np.array([[0.5, 0.75**0.5], [-1.0, 0.0], [0.5, -(0.75**0.5)]], np.float32)
    meetings = np.zeros((*TILES, len(INVERSE_DEPTHS)), MEETING)
    meetings["inverse_depth"], meetings["steps"], meetings["cells"] = INVERSE_DEPTHS, 4, 1.5
    meetings["focused"][:, 1:], meetings["opaque"][1, :, 1], meetings["level"][:, ::2] = 1, 1, 1
    meetings["steps"][0, 0, 0] = -1
    eights = np.array([[1, 2, 2], [2, 1, 2]])
    layers = tuple(_layer(depth, number, wavelengths) for number, depth in enumerate(INVERSE_DEPTHS))
    return Casting(rays, CENTRE_PX, (0.01, 0.012) if mesh else (0.0, 0.0), np.linspace(1, 0.7, 9, dtype=np.float32),
                   blades[:0] if mesh else blades, (0.7, 0.1, 0.9), 0.7, layers, (0.01,) * wavelengths, meetings,
                   eights - 1, eights, np.reshape(STEPS, TILES), TILE_PX)


def _height_rays(wavelengths):
    """Heights up to 60 px; each ray lands at the pixel, and moves with its place in the stop."""
    nodes = 7
    outwards = np.linspace(0, 60, nodes)[:, None, None]
    return HeightRays(_values(wavelengths, outwards, 0 * outwards, coloured=True), (nodes - 1) / 60)


def _mesh_rays(wavelengths):
    rows, columns, first = 4, 5, (-0.2, -0.1)
    per_px = 0.1
    places = [(np.arange(FINER * (n - 1) + 1) / FINER + at) / per_px
              for n, at in zip((rows, columns), first, strict=True)]
    y, x = np.meshgrid(*places, indexing="ij")
    shift = 1 + 0.01 * np.arange(wavelengths)
    chief = np.stack([each[..., None] * shift for each in (x, y)], axis=-1, dtype=np.float32)
    right, up = (each[::FINER, ::FINER].reshape(-1, 1, 1) / 60 for each in (x, y))
    values = _values(wavelengths, right, up, coloured=False).reshape(rows, columns, 3, -1, 8)
    return MeshRays(values, chief, (per_px, per_px), first, (True, True))


def _values(wavelengths, one, two, coloured):
    """Three eights of rays at nodes with these positions at infinity, which vary with the wavelength if `coloured`: see
    `HeightRays`."""
    angle, radius = np.arange(24).reshape(3, 8) * 2.4, np.sqrt((np.arange(24).reshape(3, 8) + 0.5) / 24)
    first, second = radius * np.cos(angle), radius * np.sin(angle)
    values = np.zeros((len(one), 3, STOP + QUANTITIES * wavelengths, 8), np.float32)
    values[:, :, 0], values[:, :, 1] = second, first
    for w in range(wavelengths):
        spread = 1 + 0.02 * w
        values[:, :, STOP + QUANTITIES * w:STOP + QUANTITIES * (w + 1)] = np.stack(np.broadcast_arrays(
            one * (spread if coloured else 1) + 0.5 * first, two + 0.5 * second,
            BLUR_PX * spread * first * (1 + 0.002 * one), BLUR_PX * second,
            4 * (1.2 - radius - 0.002 * np.abs(one)) - 0.6, 1 - 0.3 * radius**2), axis=2)
    return values


def _layer(inverse_depth, number, wavelengths):
    """A layer that ends at its rows; or one that continues, behind others."""
    rows, columns = np.indices(LAYER_PX, np.float32)
    alpha = np.ones_like(rows) if number else np.clip(2 * np.sin(rows / 7) * np.cos(columns / 9), 0, 1)
    light = np.stack([alpha * (1 + w + np.sin(rows / (3 + w)) * np.cos(columns / 5)) for w in range(wavelengths)])
    depth = inverse_depth * (1 + 0.02 * np.sin(columns / 20)), 0.5 + 0.5 * np.sin(rows / 11)
    origin_px = ORIGINS_PX[number]
    nearer = np.clip(np.sin(np.add(*np.indices(CAPTURE_PX, np.float32)) / np.array([[[13]], [[8]]], np.float32)), 0, 1)
    planes = LayerPlanes(light, alpha, 1.0, True, origin_px, tuple(np.add(AXIS_PX, origin_px).tolist()),
                         ((bool(number),) * 2, (True, True)), KINDS[number], Nearer(*nearer, 0.0) if number else None)
    return LayerArrays(planes, np.stack(depth, axis=-1, dtype=np.float32))
