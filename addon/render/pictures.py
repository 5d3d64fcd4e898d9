"""The pictures of a job: the lens image with its alpha, its planes for compositors, and the view without the lens."""

import hashlib

import numpy as np

from lensfield.engine.field.frame_planes import nearest_samples, pinhole_view, relative_illumination
from lensfield.engine.field.stmap import distort_map, undistort_map
from lensfield.engine.image.planes import COVERAGE, NEAREST
from lensfield.engine.inspection.curves import reference_nm
from lensfield.engine.pictures.preview import to_rec709
from lensfield.engine.pictures.spectral_exr import (
    read_attribute,
    write_exr,
    write_layers_exr,
    write_picture_exr,
    write_plane_exr,
    write_rgb_exr,
)
from lensfield.engine.runtime.build_identity import build_identity
from lensfield.engine.runtime.errors import ImageError
from lensfield.engine.runtime.files import file_status
from lensfield.engine.simulation.coverage import coverage
from lensfield.engine.simulation.surface_coverage import surface_coverage
from lensfield.engine.truth.mattes import names_in_files
from lensfield.engine.truth.through_lens import file_attributes, truth_through_lens

from ...request import TRUTH
from ..capture.captured import ALPHA, DEPTH
from ..job.shown import write_shown

REGION = "region"  # the channel of Blender's render region
MADE_OF = "lensfield:of"  # attribute of a plane: a digest of the lens, the frame and the build


def write_radiance(captured, path, attributes):
    """Write the radiance, with the capture's depth, alpha, region, layers and sources outside it: the input for another
    lens; and further attributes, dict of str."""
    planes = {name: plane.values for name, plane in captured.planes.items()}
    write_exr(captured.radiance, path, planes if captured.region is None else planes | {REGION: captured.region},
              captured.layers, outside=captured.outside, attributes=attributes)


def write_stray(stray, frame_px, result):
    """Write the stray light in a lens image of this size for compositors: black for None."""
    write_picture_exr(np.zeros((*frame_px, 3), np.float32) if stray is None else to_rec709(stray), result.stray)


def write_pictures(captured, irradiance, after, exposure, light_exposure, look, attributes, lens, options, iris,
                   result):
    """Write the lens image and its planes; and PNGs of the frame through a perfect pinhole and through the lens, which
    have the same exposure unless the latter is a camera's.

    Parameters
    ----------
    captured : Captured
    irradiance : SpectralImage
    after : array (row, column, 3)
        The lens image, or its developed picture, in linear Rec. 709.
    exposure, light_exposure : float
        Exposures in sRGB of the PNGs of the lens image and of the pinhole picture.
    look : Look or None
        Of both; None for sRGB.
    attributes : dict of str or None
        Of the lens image's file, if no spectral file states them.
    lens : Lens
    options : Options
    iris : Iris or None
    result : Result
        Names the files.
    """
    frame = irradiance.grid
    after = captured.cut_picture(after)  # a camera's has noise everywhere
    planes = planes_through_lens(captured, lens, options, iris)
    write_picture_exr(after, result.lens_image, captured.cut(planes.get(ALPHA, np.ones(frame.shape_px))), attributes)
    write_plane_exr(planes[DEPTH], result.depth)
    _write_lens_planes(lens, frame, result)
    before = pinhole_view(np.moveaxis(to_rec709(captured.radiance), -1, 0), lens, captured.radiance.grid)
    write_shown(captured.cut_picture(np.moveaxis(before, 0, -1)), result.before, light_exposure, look)
    write_shown(after, result.after, exposure, look)


def write_truth(captured, lens, frame, options, iris, result, progress):
    """Write the ground truth of a lens image's frame, a PixelGrid: of chief rays, and coverage."""
    truth = captured.truth
    planes = truth_through_lens(truth, lens, frame, reference_nm(lens))
    planes |= _masks(captured, lens, options, iris, progress)
    write_layers_exr({f"{truth.layer}.{channel}": captured.cut(plane) for channel, plane in planes.items()},
                     result.truth, file_attributes(truth))
    result.report.files["truth"] = str(result.truth)


def _masks(captured, lens, options, iris, progress):
    """The masks of all requested kinds of coverage, by channel."""
    masks, kinds = [], captured.truth.mattes
    for number, (kind, mattes) in enumerate(kinds.items()):
        covered = surface_coverage(mattes.shares, captured.radiance, lens, options, reference_nm(lens),
                                   layers=captured.layers, iris=iris,
                                   progress=lambda part, number=number: progress((number + part) / len(kinds)))
        masks += [(f"{TRUTH[kind][0]} {name}", mask) for name, mask in mattes.masks(covered)]
    names = names_in_files([name for name, _ in masks])
    return {f"{name}.X": mask for name, (_, mask) in zip(names, masks, strict=True)}


def write_film_pictures(film, irradiance, picture, exposure, _, look, attributes, lens, result):
    """Write the lens image and its planes, for a film that was rendered through the lens itself.

    Parameters
    ----------
    film : Captured
    irradiance, picture, exposure, look, attributes, lens, result
        As in `write_pictures`.
    """
    frame, picture = irradiance.grid, film.cut_picture(picture)
    alpha = np.ones(frame.shape_px) if film.alpha is None else film.alpha
    write_picture_exr(picture, result.lens_image, film.cut(alpha), attributes)
    write_plane_exr(film.depth_m, result.depth)
    _write_lens_planes(lens, frame, result)
    write_shown(picture, result.after, exposure, look)


def _write_lens_planes(lens, frame, result):
    nm = reference_nm(lens)
    _write_once(result.relative_illumination, relative_illumination, write_plane_exr, lens, frame, nm)
    _write_once(result.stmap_distort, distort_map, write_rgb_exr, lens, frame, nm)
    _write_once(result.stmap_undistort, undistort_map, write_rgb_exr, lens, frame, nm)


def _write_once(path, make, write, lens, frame, nm):
    """Write a plane that depends on the lens alone, unless the file's header says that it is the same."""
    of = hashlib.sha256(repr((lens.digest, frame, nm, build_identity())).encode()).hexdigest()
    if not _is_of(path, of):
        write(make(lens, frame, nm), path, {MADE_OF: of})


def _is_of(path, of):
    try:
        return bool(file_status(path)) and read_attribute(path, MADE_OF) == of
    except ImageError:  # damaged
        return False


def planes_through_lens(captured, lens, options, iris=None):
    """The planes of a lens image: dict of str: array (row, column) of the frame.

    Of alpha, layers state their own.
    """
    grid, nm, layers = captured.radiance.grid, reference_nm(lens), captured.layers
    shown = {name: nearest_samples(plane.values, lens, grid, nm)
             for name, plane in captured.planes.items() if plane.kind == NEAREST}
    masks = {name: [layer.alpha for layer in layers.layers] if layers else plane.values
             for name, plane in captured.planes.items() if plane.kind == COVERAGE}
    if masks:
        covered = coverage(list(masks.values()), captured.radiance, lens, options, layers=layers, iris=iris)
        shown |= dict(zip(masks, covered, strict=True))
    return shown
