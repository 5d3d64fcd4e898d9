"""What a capture yields: the radiance of a scene, with depth and alpha."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lensfield.engine import SpectralImage
from lensfield.engine.depth.depth_range import check_depth
from lensfield.engine.image.layers import LayeredRadiance
from lensfield.engine.image.planes import COVERAGE, NEAREST, Plane
from lensfield.engine.image.sources import Sources
from lensfield.engine.truth.captured_truth import CapturedTruth

from ..scene.units import M_TO_MM
from .remarks import scale_remarks

BACKGROUND_M = 1e10
DEPTH, ALPHA = "Z", "A"
KINDS = {DEPTH: NEAREST, ALPHA: COVERAGE}


def planes_of(values):
    """Planes by name, from their values, skipping None: dict of str: Plane."""
    return {name: Plane(values[name], kind) for name, kind in KINDS.items() if values.get(name) is not None}


@dataclass(frozen=True, eq=False)
class Captured:
    """The radiance of a scene from its passes, with depth and alpha.

    Attributes
    ----------
    radiance : SpectralImage
        Premultiplied by alpha.
    planes : mapping of str to Plane
        By the names of their channels in files: DEPTH, in metres along the optical axis, BACKGROUND_M for the
        background; and ALPHA, if the film is transparent or shows holdouts.
    region : float32 array (row, column) or None
        1 in Blender's render region, the only part of the picture; 0.5 around it, where the lens may draw light from; 0
        elsewhere. None without a render region.
    layers : LayeredRadiance or None
        The radiance in layers of depth; None if the lens data hold at all depths, or if layers were not requested.
    remarks : tuple of str
        Remarks on the scene's contents, shared by all frames of this capture.
    outside : Sources or None
        Sources of stray light that the radiance does not contain; None if they are not known.
    truth : CapturedTruth or None
        The requested ground truth.
    """

    radiance: SpectralImage
    planes: Mapping[str, Plane]
    region: np.ndarray | None
    layers: LayeredRadiance | None = None
    remarks: tuple[str, ...] = ()
    outside: Sources | None = None
    truth: CapturedTruth | None = None

    @property
    def depth_m(self):
        """The values of DEPTH: array (row, column)."""
        return self.planes[DEPTH].values

    @property
    def alpha(self):
        """The values of ALPHA: array (row, column), or None."""
        return self.planes[ALPHA].values if ALPHA in self.planes else None

    def depth_check(self, lens):
        """How much of the frame is outside the depths at which a lens's data hold: DepthCheck."""
        return check_depth(self._frame_mm(), lens, self.radiance.pitch_um, empty=self._frame(self._empty),
                           light=self._frame(self.radiance.cube.mean(axis=0)))

    def scale_remarks(self, *lenses):
        """The `scale_remarks` for the frame and its lenses: tuple of str."""
        depth_mm = self._frame_mm()
        depth_mm = np.where(depth_mm < BACKGROUND_M * M_TO_MM, depth_mm, np.inf)
        return tuple(map(str, scale_remarks(depth_mm, lenses, self.radiance.pitch_um)))

    @property
    def _empty(self):
        """The pixels of the background without light."""
        background = self.depth_m >= BACKGROUND_M
        return background & ~self.radiance.cube.any(axis=0) if background.any() else background

    def _frame_mm(self):
        return self._frame(self.depth_m) * M_TO_MM

    def _frame(self, plane):
        """A plane's values at the pixels of the frame, or only of the render region."""
        (top, left), (rows, columns) = self.radiance.overscan_px, self.radiance.frame_px
        frame = slice(top, top + rows), slice(left, left + columns)
        return plane[frame][... if self.region is None else self.region[frame] == 1]

    def cut(self, planes):
        """Planes (..., row, column) of the frame, black outside the render region."""
        if self.region is None:
            return planes
        (top, left), (rows, columns) = self.radiance.overscan_px, self.radiance.frame_px
        return planes * (self.region[top:top + rows, left:left + columns] == 1)

    def cut_picture(self, picture):
        """A picture (row, column, 3) of the frame, black outside the render region."""
        return np.moveaxis(self.cut(np.moveaxis(picture, -1, 0)), 0, -1)
