"""The pictures of the bundled lenses: a bust at night with lamps behind it, and points from the centre to the corner.

    python docs/figures/lens_pictures.py [NAME ...]

writes engine/library/pictures/NAME.jpg for these lenses, or for each lens without a picture of its present figures;
`make lens-pictures` does that with Blender's wheel. Each lens is wide open and focused on the bust, which is equally
large in every picture: a longer lens is farther away, and a lamp at infinity becomes a disc as large as the lens's
entrance pupil would be next to the bust. Pictures of anamorphic lenses are unsqueezed. Cycles renders only the bust,
once.
"""

import sys
from dataclasses import fields, is_dataclass, replace
from tempfile import TemporaryDirectory

import numpy as np
import scipy
from PIL import Image

from lensfield.engine import Options, simulate
from lensfield.engine.field.overscan import choose_capture
from lensfield.engine.image.layers import LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.inspection.curves import WHITE_NM
from lensfield.engine.inspection.grid_curves import displacement_um, mirror_image, psfs_at
from lensfield.engine.inspection.white_light import in_white_light, white_psfs
from lensfield.engine.lens import GridLens
from lensfield.engine.library import PICTURES, bundled_names, load_lens, prescription_of
from lensfield.engine.pictures.preview import to_rec709
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.rings import Rings, capture_focal_length_mm
from lensfield.engine.runtime.values import digest_of
from lensfield.engine.spectral.colour import encode_srgb
from night_scene import render_bust, scene_layers

EDITION = 1  # of the scene: raise it to replace all pictures
FRAME_PX, SHOWN_PX = (231, 384), (154, 256)
POINTS, POINT_PX = 5, (38, 51)  # in the row below the picture
POINT_VIEW, POINT_LIGHT = 0.009, 60.0  # height that a point's picture shows, in heights of the frame
FRAME_HEIGHT_MM = 250  # at the bust
ROOM_PX, REACH_PX = 64, 24  # the overscan of the capture that lenses share; the pixels of it that only blur needs
WAVELENGTHS_NM = range(430, 671, 40)
OPTIONS = Options(accuracy=0.05)
EXPOSURE, CONTRAST, QUALITY = 1.9, 1.35, 84


def main(names):
    marks = {name: mark(name) for name in names or filter(is_stale, bundled_names())}  # refuses unknown names
    if not marks:
        return
    with TemporaryDirectory() as folder:
        bust = render_bust(folder)
    shared = scene_layers(bust, shared_grid(1.0), 1.0, WAVELENGTHS_NM)
    for name, comment in marks.items():
        lens = focused(name)
        picture, row = developed(scene_picture(lens, bust, shared)), developed(points(lens))
        write(PICTURES / f"{name}.jpg", picture, row, comment)
        print(name, flush=True)


def is_stale(name):
    """Whether a lens lacks a picture of its present figures."""
    path = PICTURES / f"{name}.jpg"
    return not path.is_file() or Image.open(path).info.get("comment") != mark(name)


def mark(name):
    """The JPEG comment: a digest of everything in a prescription that affects the picture."""
    texts = dict.fromkeys(("maker", "story", "source", "notes", "title"), "")
    figures = stated(replace(prescription_of(name), year=None, character=(), **texts))
    return digest_of((EDITION, figures)).hex()[:16].encode()


def stated(value):
    """A value with tuples of names and values in place of dataclasses, without the fields that have their defaults:
    pictures outlast fields that are new."""
    if is_dataclass(value):
        return tuple((field.name, stated(getattr(value, field.name))) for field in fields(value)
                     if field.compare and getattr(value, field.name) != field.default)
    return tuple(map(stated, value)) if isinstance(value, tuple) else value


def focused(name):
    """A lens focused on the bust, or as close to that as its focus ring allows."""
    prescription = prescription_of(name)
    height_mm = frame_height_mm(prescription.sensor_mm, system_of(prescription).squeeze)
    distance_mm = FRAME_HEIGHT_MM * capture_focal_length_mm(prescription) / height_mm
    return load_lens(name, Rings(distance_mm), quality="preview", wavelengths_nm=WAVELENGTHS_NM)


def frame_height_mm(sensor_mm, squeeze):
    """Height of the largest frame on a sensor, of a picture that is unsqueezed."""
    return min(sensor_mm[1], squeeze * sensor_mm[0] * FRAME_PX[0] / FRAME_PX[1])


def shared_grid(pitch_um):
    """The capture for most lenses, a plane: its layers depend neither on the focal length nor on the pitch."""
    return PixelGrid.around_frame(FRAME_PX, pitch_um, (ROOM_PX, ROOM_PX))


def scene_picture(lens, bust, shared):
    """The scene through a lens: linear Rec. 709 array with the columns of FRAME_PX and, if squeezed, more rows."""
    frame_px = round(FRAME_PX[0] * lens.squeeze), FRAME_PX[1]
    pitch_um = 1e3 * frame_height_mm(lens.sensor_mm, lens.squeeze) / frame_px[0]
    focal_mm = lens.capture_focal_length_mm
    grid = choose_capture(lens, PixelGrid(frame_px, pitch_um), WAVELENGTHS_NM, round(REACH_PX * lens.squeeze))
    if grid.projection.is_plane and grid.squeeze == 1 and max(grid.overscan_px) <= ROOM_PX:
        grid, layers = shared_grid(pitch_um), shared
    else:
        layers = scene_layers(bust, grid, focal_mm, WAVELENGTHS_NM)
    distance_mm = lens.object_distance_mm + lens.entrance_pupil_mm
    layers = [replace(layer, depth_mm=layer.depth_mm * distance_mm) for layer in layers]
    return to_rec709(simulate(LayeredRadiance(layers, WAVELENGTHS_NM, grid, focal_mm=focal_mm), lens, OPTIONS))


def points(lens):
    """White points from the centre to the frame's corner, side by side: with outwards to the right or, of a lens
    without rotational symmetry, to the upper right corner."""
    height_mm = frame_height_mm(lens.sensor_mm, lens.squeeze)
    corner_mm = height_mm / 2 * np.array((FRAME_PX[1] / FRAME_PX[0] / lens.squeeze, 1))
    psfs = (grid_points if isinstance(lens, GridLens) else radial_points)(lens, corner_mm)
    pitch_px = lens.psf_pitch_um * POINT_PX[0] / (1e3 * POINT_VIEW * height_mm) * np.array((1, lens.squeeze))
    return POINT_LIGHT * np.concatenate([in_pixels(psf, pitch_px) for psf in psfs], axis=1)


def radial_points(lens, corner_mm):
    """PSFs from the centre to a corner, outwards to the right: array (point, row, column, 3)."""
    real_mm = lens.real_height_mm[lens.wavelengths_nm.size // 2]
    places_mm = np.linspace(0, np.hypot(*corner_mm), POINTS)
    return white_psfs(lens, np.abs(real_mm[:, None] - places_mm).argmin(axis=0)).swapaxes(1, 2)


def grid_points(lens, corner_mm):
    """PSFs from the centre to a corner, as in the picture: array (point, row, column, 3)."""
    places_mm = np.linspace(0, corner_mm, POINTS).T
    moved_um = displacement_um(lens, WHITE_NM, *places_mm)
    return mirror_image(in_white_light(lens, psfs_at(lens, *places_mm), moved_um[..., ::-1]), 1)


def in_pixels(psf, pitch_px):
    """The light of a PSF on the POINT_PX pixels around its middle, from samples this far apart along both axes."""
    for axis, (count, pitch) in enumerate(zip(POINT_PX, pitch_px, strict=True)):
        edges_px = (np.arange(psf.shape[axis] + 1) - psf.shape[axis] // 2 - 0.5) * pitch
        begin = [(int(each == axis), 0) for each in range(psf.ndim)]
        sums = scipy.interpolate.PchipInterpolator(edges_px, np.pad(np.cumsum(psf, axis), begin), axis)
        psf = np.diff(sums(np.clip(np.arange(count + 1) - count / 2, *edges_px[[0, -1]])), axis=axis)
    return psf


def write(path, picture, row, comment):
    """Write a picture, reduced in size, above the row of points."""
    small = Image.fromarray(picture).resize(SHOWN_PX[::-1], Image.Resampling.LANCZOS)
    row = np.pad(row, ((0, 0), (0, SHOWN_PX[1] - row.shape[1]), (0, 0)))
    Image.fromarray(np.concatenate([small, row])).save(path, quality=QUALITY, optimize=True, comment=comment)


def developed(rec709):
    """Linear light in 8-bit sRGB; highlights approach white as on film."""
    return np.round(255 * encode_srgb(1 - np.exp(-EXPOSURE * np.maximum(rec709, 0))) ** CONTRAST).astype(np.uint8)


if __name__ == "__main__":
    main(sys.argv[1:])
