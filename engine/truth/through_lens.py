"""Ground truth of a lens image: what the chief ray of each pixel meets, in the place where the lens shows it."""

from itertools import groupby

import numpy as np

from ..field.chief_rays import ChiefRays
from ..image.pixel_grid import PixelGrid
from ..lens.lens import Lens
from .captured_truth import BACKGROUND_M, DEPTH, NORMAL, UV, VECTOR, CapturedTruth
from .coco import OBJECTS, objects_text
from .cryptomatte import attributes_of

FORWARDS = 1, 1, -1  # signs between directions towards the scene and the camera's axes, whose z is backwards


def truth_through_lens(truth: CapturedTruth, lens: Lens, frame: PixelGrid,
                       wavelength_nm: float) -> dict[str, np.ndarray]:
    """Ground truth at the pixels of a lens image.

    Ids and Cryptomatte are those of the capture's nearest pixel. Depth, normals, UV and motion continue from there
    along the surface: see `ChiefRays.continued`.

    Parameters
    ----------
    truth : CapturedTruth
    lens : Lens
    frame : PixelGrid
        Of the lens image.
    wavelength_nm : float
        Whose chief rays.

    Returns
    -------
    dict of str to float32 array (row, column)
        By channel, with Blender's names and conventions, except that lengths are in metres. Depth.Z and Distance.Z are
        along the optical axis and along the ray, BACKGROUND_M for the background. Vector.X and Vector.Y are the way
        back to the surface's place at the frame before, Vector.Z and Vector.W the way from its place at the next
        frame, in pixels of the lens image to the right and up. The background is at infinity, and moves if the camera
        turns.
    """
    rays, result = ChiefRays(lens, frame, truth.grid, wavelength_nm), {}
    for name, channels in groupby(truth.planes, key=lambda channel: channel.partition(".")[0]):
        planes = {channel: truth.planes[channel] for channel in channels}
        result |= _OF_PASS.get(name, _nearest)(planes, rays, truth)
    return {channel: plane.astype(np.float32, copy=False) for channel, plane in result.items()}


def file_attributes(truth: CapturedTruth) -> dict[str, str]:
    """Attributes of the header of a file with ground truth: the names in its Cryptomatte layers, and its objects."""
    mattes = {name: text for layer, names in truth.names.items()
              for name, text in attributes_of(f"{truth.layer}.{layer}", names).items()}
    return mattes | ({OBJECTS: objects_text(truth.objects)} if truth.objects else {})


def _nearest(planes, rays, _):
    return {channel: rays.nearest(plane) for channel, plane in planes.items()}


def _places(planes, rays, truth):
    """Depth, distance and position, as requested."""
    nearness = rays.continued(1 / planes[f"{DEPTH}.Z"])
    on_surface, towards = nearness > 0, rays.directions()
    depth_m = np.divide(1, nearness, out=np.full(nearness.shape, np.inf), where=on_surface)
    distance_m, result = depth_m / towards[..., 2], {}
    if "depth" in truth.products:
        result = {f"{name}.Z": np.where(on_surface, metres, BACKGROUND_M)
                  for name, metres in ((DEPTH, depth_m), ("Distance", distance_m))}
    if "position" in truth.products:
        from_camera_m = np.where(on_surface, distance_m, 0)[..., None] * towards * FORWARDS
        position_m = from_camera_m @ truth.to_world[:, :3].T + truth.to_world[:, 3]
        result |= {f"Position.{axis}": np.where(on_surface, position_m[..., number], 0)
                   for number, axis in enumerate("XYZ")}
    return result


def _normals(planes, rays, _):
    normals = _of_surfaces(planes, np.any([*planes.values()], axis=0), rays)
    length = np.sqrt(sum(plane**2 for plane in normals.values()))
    return {channel: plane / np.where(length, length, 1) for channel, plane in normals.items()}


def _coordinates(planes, rays, _):
    """UV; its third channel is 1 on surfaces."""
    alpha = f"{UV}.A"
    coordinates = {channel: plane for channel, plane in planes.items() if channel != alpha}
    return _of_surfaces(coordinates, planes[alpha] > 0, rays) | {alpha: rays.nearest(planes[alpha])}


def _of_surfaces(planes, known, rays):
    """Planes at the chief rays, continued from the known pixels of the capture; 0 elsewhere."""
    return {channel: np.nan_to_num(rays.continued(np.where(known, plane, np.nan))) for channel, plane in planes.items()}


def _motion(planes, rays, truth):
    background = rays.nearest(np.isinf(truth.planes[f"{DEPTH}.Z"]))
    result = {}
    for axes, sign, axes_then in zip(("XY", "ZW"), (1, -1), truth.neighbours, strict=True):
        of_surfaces = rays.moved(*(sign * rays.continued(planes[f"{VECTOR}.{axis}"]) for axis in axes))
        of_background = rays.turned(_turn(truth.to_world[:, :3], axes_then))
        result |= {f"{VECTOR}.{axis}": sign * np.where(background, *parts)
                   for axis, *parts in zip(axes, of_background, of_surfaces, strict=True)}
    return result


def _turn(axes_now, axes_then):
    """From directions in a camera to directions in the camera as it was, or will be: to the right, up and forwards."""
    if np.array_equal(axes_now, axes_then):
        return np.eye(3)  # exactly, so that nothing moves
    return np.linalg.solve(axes_then, axes_now) * np.outer(FORWARDS, FORWARDS)


_OF_PASS = {DEPTH: _places, NORMAL: _normals, UV: _coordinates, VECTOR: _motion}
