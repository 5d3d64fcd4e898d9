"""Depth from a file of any program: converted to mm for the planner, and to layers."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..depth.depth_range import blur_per_nearness_px, planar_depth_mm
from ..depth.hidden import layers_of_picture, with_hidden
from ..depth.slabs import SlabPlan
from ..image.layers import LayeredRadiance
from ..image.pixel_grid import PixelGrid
from ..image.spectral_image import SpectralImage
from ..lens.lens import Lens
from ..pictures.deep_exr import DeepPicture
from ..pictures.depth_channel import depth_in_mm, numbers_of_depth, without_mixtures
from ..pictures.rgb_picture import RgbPicture

DEPTH_KINDS = "z", "distance"
"""How depth is measured: along the camera's axis, or as the distance from the camera to the visible point."""


@dataclass(frozen=True, eq=False)
class FileDepth:
    """Depth of each pixel of a picture.

    Attributes
    ----------
    planar_mm : array (row, column)
        Along the axis; NaN for a fisheye's pixels that show points behind the camera.
    clip_mm : array (row, column)
        As a camera clips: equal to `planar_mm`, except for a fisheye, where it is the distance.
    unknown : float
        Fraction of the pixels with an invalid number, which are assumed to be infinitely far.
    """

    planar_mm: np.ndarray
    clip_mm: np.ndarray
    unknown: float


def file_depth(plane: np.ndarray, lens: Lens, capture: PixelGrid, unit_mm: float, kind: str = "z") -> FileDepth:
    """Depth from a file's channel.

    Parameters
    ----------
    plane : array (row, column)
        For all pixels of the capture.
    lens : Lens
        The camera was in its entrance pupil.
    capture : PixelGrid
    unit_mm : float
        Length of the file's unit.
    kind : "z" or "distance"
        A fisheye's depth is always a distance.
    """
    numbers, unknown = numbers_of_depth(plane)
    numbers = without_mixtures(numbers, blur_per_nearness_px(lens, capture.pitch_um) / unit_mm)
    clip_mm = depth_in_mm(numbers, unit_mm)
    if capture.projection.is_plane:
        clip_mm = clip_mm / along_axis(lens, capture, kind)
    return FileDepth(planar_depth_mm(clip_mm, lens, capture).astype(np.float32), clip_mm, unknown)


def along_axis(lens: Lens, capture: PixelGrid, kind: str) -> np.ndarray:
    """Ratio of a plane capture's numbers to depth along the axis: array (row, column)."""
    if kind == "z":
        return np.ones(capture.shape_px, np.float32)
    focal_mm = capture.focal_mm or lens.capture_focal_length_mm
    x_mm, y_mm = (axis / focal_mm for axis in capture.axes_mm())
    return np.sqrt(1 + x_mm**2 + y_mm[:, None]**2).astype(np.float32)


def layers_of_flat(radiance: SpectralImage, depth: FileDepth, plan: SlabPlan) -> LayeredRadiance:
    """A picture and its depth as the layers of a plan. Hidden surfaces are guessed (`hidden`)."""
    slab = np.searchsorted(plan.borders_mm, depth.clip_mm, side="right")
    return layers_of_picture(radiance, np.where(np.isnan(depth.planar_mm), np.inf, depth.planar_mm), slab, plan.slabs)


def layers_of_deep(radiance: SpectralImage, deep: DeepPicture, plan: SlabPlan,
                   light: Callable[[RgbPicture], SpectralImage]) -> LayeredRadiance:
    """A deep picture as the layers of a plan. Surfaces without samples behind nearer ones are guessed.

    Parameters
    ----------
    radiance : SpectralImage
        The complete pinhole picture.
    deep : DeepPicture
        Its depth in mm along the axis.
    plan : SlabPlan
    light : callable (picture)
        Radiance of a picture in RGB.
    """
    slabs = deep.slabs(np.searchsorted(plan.borders_mm, deep.depth, side="right"), plan.slabs)
    pictures, alphas, depths_mm = zip(*slabs, strict=True)
    return with_hidden(radiance, alphas, depths_mm, lambda number: light(pictures[number]).cube)


def deep_in_mm(deep: DeepPicture, lens: Lens, capture: PixelGrid, unit_mm: float, kind: str = "z") -> DeepPicture:
    """A deep picture with depth in mm along the axis."""
    numbers, _ = numbers_of_depth(deep.depth)
    return deep.at(depth_in_mm(numbers, unit_mm) / along_axis(lens, capture, kind).ravel()[deep.pixel])
