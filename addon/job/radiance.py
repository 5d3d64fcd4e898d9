"""The capture: scene -> spectral radiance, pass by pass, with the overscan that the lens needs."""

from collections.abc import Callable
from dataclasses import dataclass

import bpy
import numpy as np

from ...engine import SpectralImage
from ...engine.files import check_target, temporary_folder
from ...engine.image.depth_range import check_depth, planar_depth_mm
from ...engine.image.pixel_grid import PixelGrid
from ...engine.image.preview import auto_exposure, to_rec709, write_png
from ...engine.image.spectral_exr import read_parts
from ...engine.report import SceneFacts
from ...engine.spectral.wavelength_choice import FOREIGN_SURPRISE
from ..scene.camera import capture_grid, captured_region, check_camera, frame_px, pitch_um, render_region
from ..scene.depth import M_TO_MM
from ..scene.errors import SceneError
from ..scene.render_state import clamps_of, go_to_frame, guard_render_state, rendered_layer, turn_on_layer
from ..scene.traced_camera import trace_lens
from ..scene.undo import Journal
from .bands import CHANNELS
from .remarks import scene_remarks, unlayered_remarks
from .scene_plan import plan_scene

ROWS_AT_ONCE = 16  # which stay in the processor's cache
BLOCK_PX = 8  # side of the blocks whose means are free enough of noise to judge spectra by
BACKGROUND_M = 1e10


@dataclass(frozen=True, eq=False)
class Captured:
    """What the passes tell of a scene.

    Attributes
    ----------
    radiance : SpectralImage
        Premultiplied by alpha.
    depth_m : float32 array (row, column)
        As Blender's depth passes have it: along the optical axis, BACKGROUND_M where nothing is.
    alpha : float32 array (row, column) or None
        None where the film is not transparent.
    region : float32 array (row, column) or None
        1 in Blender's render region, which alone is to be a picture; 0.5 around it, where there is light, too, that the
        lens may bring in; 0 elsewhere. None without one.
    """

    radiance: SpectralImage
    depth_m: np.ndarray
    alpha: np.ndarray | None
    region: np.ndarray | None

    def cut(self, planes):
        """Planes (..., row, column) of the frame, black outside the render region."""
        if self.region is None:
            return planes
        (top, left), (rows, columns) = self.radiance.overscan_px, self.radiance.frame_px
        return planes * (self.region[top:top + rows, left:left + columns] == 1)


@dataclass(frozen=True)
class RenderPass:
    """Step: render the scene as it stands, to the file that it names.

    `fraction` of the whole job is done before this step, `share` of it is this step's.
    """

    scene: bpy.types.Scene
    label: str
    fraction: float
    share: float


@dataclass(frozen=True)
class Work:
    """Step: call `call(progress)`, which may run in another thread and must not touch Blender."""

    call: Callable
    label: str
    fraction: float
    share: float = 0.0


def job_grid(scene, job):
    """The pixels that Cycles renders: those of a capture, or of the film behind a lens that is traced."""
    if job.traced:
        return PixelGrid(frame_px(scene), pitch_um(job.lens, frame_px(scene)))
    return capture_grid(scene, job.lens, job.wavelengths_nm, job.room)


def capture(scene, job, result, share):
    """Steps that render the scene's spectral radiance, up to a `share` of the whole job; returns what is Captured.

    Where the lens is traced it is the film's irradiance, on the frame's pixels.
    """
    grid = job_grid(scene, job)
    with temporary_folder() as folder, Journal() as journal:
        go_to_frame(scene, job.frame, journal)
        turn_on_layer(scene, job.view_layer, journal)
        check_camera(scene)
        remarks = [*scene_remarks(scene, job), *unlayered_remarks(scene, job, grid)]
        exposure = scene.cycles.film_exposure
        plan, substitution, groups = plan_scene(scene, job, grid, journal)
        plan.check()
        names = groups.part(rendered_layer(scene), journal)
        region = render_region(scene)
        rendered = region if job.traced or not region else captured_region(region, job.lens, job.wavelengths_nm, grid,
                                                                           job.room)
        guard_render_state(scene, job, grid, rendered, folder / "pass.exr", journal)
        for path in result.files:
            check_target(path)
        layer, clamps = rendered_layer(scene).name, clamps_of(scene)
        gathered = _Gathered(plan, [f"{layer}.Combined", *(f"{layer}.Combined_{name}" for name in names)],
                             f"{layer}.Depth.Z", grid)
        for index, band in enumerate(plan.bands):
            substitution.set_wavelengths(band, plan.dispersive)
            for name, clamp in clamps.items():
                journal.set(scene.cycles, name, clamp * substitution.brightest(band) if job.clamp else 0.0)
            if job.traced:
                trace_lens(scene, job.lens, grid, band[0], journal)
            step = share / len(plan.bands)
            yield RenderPass(scene, f"Pass {index + 1} of {len(plan.bands)}: {_span(band)} nm", step * index, step)
            yield Work(lambda tell, index=index: gathered.add(index, folder / "pass.exr"), "Gathering light",
                       step * (index + 1))
            if job.picture:
                yield Work(lambda tell, index=index: gathered.show(index, job.picture), "Showing it so far",
                           step * (index + 1))
    depth_mm = planar_depth_mm(gathered.depth_m * M_TO_MM, job.lens, grid)
    result.report.scene = gathered.facts(job, depth_mm, region, remarks)
    return Captured(SpectralImage(gathered.radiance(), job.wavelengths_nm, grid,
                                  focal_mm=job.lens.capture_focal_length_mm, exposure=exposure),
                    np.where(np.isfinite(depth_mm), depth_mm / M_TO_MM, BACKGROUND_M).astype(np.float32),
                    gathered.alpha if scene.render.film_transparent else None,
                    region and _mask(region, rendered, grid))


class _Gathered:
    """The radiance at the wavelengths asked for, summed up pass by pass."""

    def __init__(self, plan, light_passes, depth_pass, grid):
        self._plan, self._grid = plan, grid
        self._light_passes, self._depth_pass = light_passes, depth_pass
        self._cube = np.zeros((plan.choice.output_nm.size, *grid.shape_px), np.float32)
        self._blocks, self.depth_m, self.alpha = {}, None, None

    def add(self, index, path):
        """Add a pass's light of each lamp in red, green and blue; and keep its depth and alpha."""
        light = (f"{name}.{channel}" for name in self._light_passes for channel in CHANNELS)
        planes = _read_pass(path, {self._depth_pass, f"{self._light_passes[0]}.A", *light})
        self.depth_m, self.alpha = planes[self._depth_pass], planes[f"{self._light_passes[0]}.A"]
        if self.depth_m.shape != self._grid.shape_px:
            raise SceneError("Cycles", "render pass", f"of {self.depth_m.shape} px",
                             f"expected {self._grid.shape_px}")
        mix = self._plan.mix(index)
        shares = (self._plan.shares(index) @ mix).astype(np.float32)
        channels = CHANNELS[:mix.shape[1]]
        means = [_block_means(planes[f"{self._light_passes[0]}.{channel}"]) for channel in channels]
        nodes = range(self._plan.choice.nodes_nm.size)[self._plan.nodes(index)]
        self._blocks |= zip(nodes, np.tensordot(mix, means, axes=1), strict=True)
        for row in range(0, self._cube.shape[1], ROWS_AT_ONCE):
            rows = slice(row, row + ROWS_AT_ONCE)
            light = np.stack([[planes[f"{name}.{channel}"][rows] for channel in channels]
                              for name in self._light_passes])
            light[0] -= light[1:].sum(axis=0)  # what is left is in no group of ours
            self._cube[:, rows] += np.tensordot(shares, light, axes=2)

    def show(self, index, path):
        """Write a PNG of the frame after a pass, as a perfect pinhole sees it: grey until all colours are there."""
        radiance = SpectralImage(self._cube, self._plan.choice.output_nm, self._grid).frame()
        whole = index + 1 == len(self._plan.bands)
        picture = to_rec709(radiance) if whole else np.stack([radiance.cube.mean(axis=0)] * 3, axis=-1)
        write_png(picture, path, auto_exposure(picture))

    def radiance(self):
        """The sum of all passes: array (wavelength, row, column). No light is negative, though an estimate may be."""
        return np.maximum(self._cube, 0, out=self._cube)

    def facts(self, job, depth_mm, region, remarks):
        """The plan, and what the passes tell of it: how well spectra were foreseen, and the frame's depths."""
        plan, choice, (top, left) = self._plan, self._plan.choice, self._grid.overscan_px
        rows, columns = self._grid.frame_px
        surprise = choice.surprise(np.array([self._blocks[node] for node in sorted(self._blocks)]))
        foreign = bool(surprise > FOREIGN_SURPRISE)
        return SceneFacts(
            passes=len(plan.bands), wavelengths_per_pass=plan.per_pass,
            rendered_nm=[round(float(nm), 3) for nm in choice.nodes_nm],
            wavelengths_nm=[float(nm) for nm in choice.output_nm], scene_plan=plan.text,
            lamps=[lamp.name for lamp in plan.lamps], predicted_colour_error=choice.colour_error,
            predicted_sensor_error=choice.sensor_error, predicted_spectral_error=choice.spectral_error,
            spectral_surprise=float(surprise), foreign_spectra=foreign,
            estimated_colour_error=choice.colour_error * (float(surprise) if foreign else 1),
            depth=None if job.traced else check_depth(
                depth_mm[top:top + rows, left:left + columns][region or ...], job.lens, self._grid.pitch_um),
            lens_warning=job.lens_warning, scene_remarks=tuple(map(str, remarks)))


def _mask(region, rendered, grid):
    """What `Captured.region` is, of slices of the frame and slices of the capture."""
    (rows, columns), (top, left) = region, grid.overscan_px
    mask = np.zeros(grid.shape_px, np.float32)
    mask[rendered] = 0.5
    mask[rows.start + top:rows.stop + top, columns.start + left:columns.stop + left] = 1
    return mask


def _block_means(plane):
    """Means of square blocks of a plane; what is left over at its ends counts for nothing."""
    rows, columns = (max(n // BLOCK_PX, 1) for n in plane.shape)
    height, width = (min(n, BLOCK_PX) for n in plane.shape)
    blocks = plane[:rows * height, :columns * width].reshape(rows, height, columns, width)
    return blocks.mean(axis=(1, 3), dtype=np.float64)


def _read_pass(path, needed):
    """The planes of a pass by name, that of the view layer first."""
    if not path.is_file():
        raise SceneError("Cycles", "render pass", "not written", "see Blender's messages above")
    planes = {name: plane for _, channels in read_parts(path) for name, plane in channels.items()}
    path.unlink()
    if not needed <= planes.keys():
        raise SceneError("Cycles", "render pass", "not whole", f"is there room left where {path.parent} is?")
    return planes


def _span(band):
    return f"{band[0]:.0f}" if band[0] == band[-1] else f"{band[-1]:.0f} to {band[0]:.0f}"
