"""Another lens for a picture: the radiance that a render has stored, put through a lens again, without Cycles.

The stored picture has a fixed field of view. Another lens shows it on a sensor that is not the lens's own size; or, for
the camera's view, the lens is scaled to fit the existing sensor.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from lensfield.engine import ImageError, InputError, Lens
from lensfield.engine.depth.depth_range import AUTO, OFF, blur_px, focus_in_capture
from lensfield.engine.field.field_map import field_map
from lensfield.engine.field.overscan import CAMERA_VIEW, LENS_VIEW
from lensfield.engine.image.extension import extended_image, extended_layers, extended_plane
from lensfield.engine.image.layers import covered
from lensfield.engine.lens.formats import format_mm
from lensfield.engine.lens.iris import opening
from lensfield.engine.lens.pinhole import fitting_pitch_um
from lensfield.engine.library import (
    clamped_rings,
    fits_all_frames,
    has_rings,
    iris_is_visible,
    pinhole_of,
    prescription_of,
)
from lensfield.engine.pictures.frame_record import check_left_out
from lensfield.engine.pictures.spectral_exr import (
    read_attribute,
    read_header,
    read_parts,
    read_sources,
    read_with_layers,
    read_with_planes,
)
from lensfield.engine.plan.options import DEFAULT_ACCURACY
from lensfield.engine.plan.plan_cache import cached_plan
from lensfield.engine.prescription.coatings import coating_of
from lensfield.engine.prescription.tolerances import copy_of
from lensfield.engine.rays.rings import Rings, resized_rings
from lensfield.engine.runtime.errors import absence
from lensfield.engine.runtime.files import check_target, discard, file_status, link_or_copy, stamp_of
from lensfield.engine.simulation.report_parts import FileFacts

from ...request import CAMERA, CAMERA_FIELDS, RADIANCE, RING_FIELDS, RenderRequest
from ..capture.captured import Captured, planes_of
from ..capture.remarks import ROUND_BLUR
from ..capture.slabs import finer_region
from ..job.job import check_output_folder, folder_for
from ..job.origin import is_light_of, stored_origin
from ..job.photo import check_photo, chosen_camera
from ..job.result import Result
from ..job.shown import LOOK
from ..job.steps import Work
from ..scene.camera import captured_region, frame_px, sensor_warning, shift_warning, size_warning
from ..scene.compositor import laid_fingerprint, shown_folder
from ..scene.lens_cache import lens_on_sensor, load_lens, scaled_lens
from ..scene.look import look_of
from ..scene.look import to_text as look_text
from ..scene.rings import ring_fields, rings_for, scene_iris
from .pictures import REGION
from .render import lens_steps, run

APPLIED_DEPTHS = AUTO, OFF
APPLIED_FIELDS = ("lens", "output_folder", "options", "stray", "view", *RING_FIELDS, "iris", "lens_quality",
                  "depth", "files", "look", "view_settings", *CAMERA_FIELDS)
STANDARD = "standard"  # quality
MOST_MISSING = 0.02  # of the frame's longer side: overscan that is made up by repeating edges
SAME = 0.005  # relative difference in sensor size up to which a lens counts as having its own view


def apply_lens(radiance, *, progress=None, **given):
    """Put a render's stored radiance through another lens, or through the same one at other settings.

    All files except the radiance are written again, or removed if `files` leaves them out.

    Parameters
    ----------
    radiance : path
        Such as shot_Scene_0001_radiance.exr, from `render_through_lens`.
    progress : callable (fraction, label), optional
    given : by name
        Fields of a `RenderRequest`: `lens`, and optionally `output_folder` (by default with the radiance), `options`,
        `stray`, `view`, `focus`, `f_number`, `focused_wide_open`, `tilt_deg`, `copy`, `copy_grade`, `coating`, `iris`,
        `lens_quality`, `depth`, `files`, `look`, `view_settings` (by default from the file), and the fields of a
        camera.

    Returns
    -------
    Result

    Raises
    ------
    LensError, ImageError, InputError
        Among others, the lens needs more than was captured: a new render is necessary.
    TypeError
        A field that only a render can obey.
    """
    for name in given:
        if name not in APPLIED_FIELDS:
            raise TypeError(f"apply_lens() got an unexpected keyword argument {name!r}")
    return run(_steps(Path(radiance), RenderRequest(**given)), progress)


def saved_radiance(scene):
    """The radiance file of a scene's render, for its current frame and by its settings.

    If the scene or its .blend had another name at the render, a link of the current name is created.

    Raises
    ------
    InputError
        The file does not exist, another scene was rendered into it, or the scene's resolution has changed since.
    """
    check_output_folder(scene)
    path = Result.of(scene, folder_for(scene), scene.frame_current).radiance
    if not file_status(path):
        _link_renamed(scene, path)
    _check_origin(scene, path)
    check_left_out(path, RADIANCE)
    if not file_status(path):
        raise InputError(path, "radiance file", absence(path), "render through the lens first")
    (left, top), (right, bottom) = read_parts(path, header_only=True)[0][0]["displayWindow"]
    size, rows_columns = (bottom - top + 1, right - left + 1), frame_px(scene)
    if size != rows_columns:
        raise InputError(path, "size", "{1} x {0} px".format(*size),
                         "the scene's resolution is now {1} x {0} px: render again".format(*rows_columns))
    return path


def _link_renamed(scene, path):
    """Link the newest radiance of this scene and frame, rendered under another name, to a path, if there is one."""
    for other in sorted(_radiance_files(scene, path.parent), key=stamp_of, reverse=True):
        if (stored := stored_origin(other)) and is_light_of(scene, stored, path.parent):
            link_or_copy(other, path)
            return


def _radiance_files(scene, folder):
    """The radiance files of a scene's frame under any name, in a folder and in the one that the compositor shows."""
    for each in {folder, *map(Path, filter(None, [shown_folder(scene)]))}:
        yield from each.glob(f"*_{scene.frame_current:04d}_radiance.exr")


def may_have_radiance(scene):
    """Whether there is a radiance file that `saved_radiance` may accept."""
    folder = folder_for(scene)  # panels ask at each redraw: usually the first file is there
    own = Result.of(scene, folder, scene.frame_current).radiance
    return bool(file_status(own)) or any(_radiance_files(scene, folder))


def _check_origin(scene, path):
    """Raise an InputError if the light of a file is of another scene, or of another .blend."""
    stored = stored_origin(path)
    if stored and not is_light_of(scene, stored, path.parent):
        raise InputError(path, "radiance file", f"rendered from {stored}", "render through the lens first")


def rendered_state(scene, radiance):
    """The scene's fingerprint from the render of a radiance file."""
    stored = stored_origin(radiance)
    return stored.state if stored else laid_fingerprint(scene)


def applied_fields(scene, request):
    """The fields of a scene's request for `apply_lens`, with its camera's focus, f-stop and iris; with layers of depth
    unless depth is off."""
    return {"lens": request.lens, "view": request.view, "options": request.options, "stray": request.stray,
            "lens_quality": request.spectral.tier, "files": request.files, "look": request.look,
            "view_settings": look_text(look_of(scene)), "depth": OFF if request.depth == OFF else AUTO,
            "iris": scene_iris(scene, request.lens), **{name: getattr(request, name) for name in CAMERA_FIELDS},
            **ring_fields(rings_for(scene, request.lens))}


def _steps(path, request):
    if request.depth not in APPLIED_DEPTHS:
        raise InputError("options", "depth", request.depth, f"expected {' or '.join(APPLIED_DEPTHS)}")
    request = replace(request, view=request.view_on_sensor, camera=chosen_camera(request))
    lens, iris, rings = request.lens, request.iris, requested_rings(request)
    result = replace(Result.from_file(path, "radiance", request.output_folder), radiance=path)
    result.report.files["radiance"] = str(path)
    for file in (file for file in result.files if file != path):
        check_target(file)
    stored, words, request = stored_radiance(path), (), with_stored_look(request, path)
    if not isinstance(lens, Lens):
        iris = iris if iris_is_visible(lens, rings) else None
        lens, words = yield Work(lambda on_progress: _turned(request, rings, stored, on_progress), "Baking the lens",
                                 0.0, 0.05)
    _check_overscan(lens, stored, request, path)
    lacking = _lacking(lens, stored, request)
    with result.report.stage("read radiance"):
        captured = yield Work(lambda _: _read(path, request.depth, result.irradiance.parent),
                              f"Reading radiance{lacking}", 0.05)
    lens, captured, warning = _fitted(lens, captured, request.view)
    check_photo(request, captured.radiance.grid)
    if captured.layers and not lens.prescription:
        words = *words, f"{lens.name}: {ROUND_BLUR}"
    warning = "; ".join(filter(None, (*words, warning, _blur_warning(lens, captured, iris),
                                           _outside_warning(captured, request))))
    _check_region(lens, captured, request.options, path)
    discard(result.record)  # the files that it describes are about to change
    yield from lens_steps(captured, lens, request, iris, result, 0.1)
    result.report.add(_facts(lens, captured, warning, result))
    result.report.write(result.record)
    return result


def with_stored_look(request, path):
    """A request with the look that a radiance file states, unless it has one."""
    return request if request.view_settings else replace(request, view_settings=read_attribute(path, LOOK))


def check_capture(radiance, **given):
    """Raise an InputError if a stored capture cannot serve a lens; the arguments are as for `apply_lens`.

    The file's header decides this, so no light is read.
    """
    request, stored = RenderRequest(**given), stored_radiance(radiance)
    lens, _ = _turned(request, requested_rings(request), stored)
    for nm in stored.wavelengths_nm:
        lens.at_wavelength(nm)
    _check_overscan(lens, stored, request, radiance)


def requested_rings(request):
    """The Rings of a request, for a lens that is given by name or path.

    Raises
    ------
    InputError
        The request takes the focus from a camera.
    """
    if request.focus == CAMERA:
        raise InputError("options", "focus", CAMERA, "expected a distance: a radiance file has no camera")
    return Rings(request.focus, request.f_number, request.focused_wide_open, tilt_deg=request.tilt_deg,
                 copy=copy_of(request.copy, request.copy_grade), coating=coating_of(request.coating))


def stored_radiance(path):
    """The radiance of a render's file by its header, without light.

    Raises
    ------
    ImageError
        An older Lensfield wrote the file.
    InputError
        The render did not write it.
    """
    check_left_out(path, RADIANCE)
    radiance, names = read_header(path)
    if radiance.focal_mm is None or "Z" not in names:
        raise ImageError(path, "lensfield:focalMm", "missing", "an older Lensfield wrote the file: render again")
    return radiance


def _read(path, depth, folder):
    layers = None
    if depth == AUTO:
        radiance, planes, layers = read_with_layers(path, scratch=folder)
    else:
        radiance, planes = read_with_planes(path, scratch=folder)
    return Captured(radiance, planes_of(planes), planes.get(REGION), layers,
                    outside=read_sources(path))


def fitted(lens, captured, request, path):
    """A lens and a Captured that suit each other, as `apply_lens` would use them for radiance from `path`.

    Raises
    ------
    ImageError
        The lens needs more than was captured.
    """
    _check_overscan(lens, captured.radiance, request, path)
    lens, captured, _ = _fitted(lens, captured, request.view)
    _check_region(lens, captured, request.options, path)
    return lens, captured


def rings_in_view(request, radiance):
    """The Rings of a request for the lens of this radiance's view."""
    rings = requested_rings(request)
    if request.view == CAMERA_VIEW and has_rings(request.lens):
        return resized_rings(prescription_of(request.lens), rings, radiance.focal_mm)
    return rings


def _turned(request, rings, stored, on_progress=lambda fraction: None):
    """The lens of a name or path for the stored radiance, and a line for each setting that it does not have."""
    lens = request.lens
    if not has_rings(lens):
        return load_lens(lens, rings), ()
    rings = rings_in_view(request, stored)
    quality = request.lens_quality or STANDARD
    baked = load_lens(lens, rings, quality, lambda fraction, _: on_progress(fraction), stored.wavelengths_nm,
                      edges_on_lens_mm(lens, rings, stored))
    return baked, clamped_rings(lens, rings)


def edges_on_lens_mm(lens, rings, radiance):
    """Edges of the frame of this radiance on the sensor of a lens, as `PixelGrid.edges_mm`; None if any will do."""
    if fits_all_frames(lens, rings):
        return None
    factor = radiance.focal_mm / pinhole_of(lens, rings).capture_focal_length_mm
    return tuple(edge_mm / factor for edge_mm in radiance.grid.frame().edges_mm)


def _fitted(lens, captured, view):
    """The lens, the radiance scaled to its sensor, so that each pixel has the same direction as in the capture, and a
    line about the difference."""
    fitted, radiance = _fit(lens, captured.radiance, view)
    if view == CAMERA_VIEW:
        factor = captured.radiance.focal_mm / lens.capture_focal_length_mm
        warning = size_warning(lens, fitted, factor)
    else:
        layers = captured.layers and _fit(lens, captured.layers, view)[1]
        captured, warning = replace(captured, radiance=radiance, layers=layers), _sensor_warning(lens, radiance, view)
    captured, repeated = _extended(fitted, captured)
    return fitted, captured, "; ".join(filter(None, (warning, repeated)))


def _fit(lens, light, view):
    """A lens scaled to the sensor of a SpectralImage or LayeredRadiance; or the lens, and this light scaled to it."""
    factor = light.focal_mm / lens.capture_focal_length_mm
    if view == CAMERA_VIEW:
        rows_mm, columns_mm = (n * light.grid.pitch_um * 1e-3 for n in light.grid.frame_px)
        return scaled_lens(lens, factor, (columns_mm, rows_mm)), light
    grid = replace(light.grid, pitch_um=light.grid.pitch_um / factor)
    return lens, replace(light, grid=grid, focal_mm=lens.capture_focal_length_mm)


def _sensor_warning(lens, radiance, view):
    """The consequences of the stored field of view for a lens, in one line; "" if it is the requested one."""
    requested = lens if view == LENS_VIEW else lens_on_sensor(lens, format_mm(view))
    if abs(radiance.pitch_um / fitting_pitch_um(requested, radiance.frame_px) - 1) < SAME:
        return shift_warning(lens, radiance.grid.frame()) if view == LENS_VIEW else sensor_warning(requested)
    rows_mm, columns_mm = (n * radiance.pitch_um * 1e-3 for n in radiance.frame_px)
    covered = field_map(lens).covered_diagonal((columns_mm, rows_mm))
    return (f"{lens.name}: the captured view equals a sensor of {columns_mm:.3g} x {rows_mm:.3g} mm (the lens's "
            f"own is {lens.sensor_mm[0]:.3g} x {lens.sensor_mm[1]:.3g} mm), and the lens covers {covered:.0%} of its "
            "diagonal. Render again for the lens's own view")


def _check_overscan(lens, stored, request, path):
    """Raise an ImageError if the capture's overscan is so much too small that a large part of a lens's frame would
    lack light."""
    lens, radiance = _fit(lens, stored, request.view)
    grid = radiance.grid
    needed = field_map(lens).overscan_px(grid, radiance.wavelengths_nm, 0)
    if max(_missing(needed, grid)) > max(1, round(MOST_MISSING * max(grid.frame_px))):
        raise ImageError(path, "overscan", "{1} x {0} px".format(*grid.overscan_px),
                         "{name} needs {1} x {0} px beyond the frame: render again through it".format(
                             *needed, name=lens.name))


def _missing(needed_px, grid):
    """The rows and columns that overscan lacks on each side."""
    return tuple(max(0, needed - available) for needed, available in zip(needed_px, grid.overscan_px, strict=True))


def _extended(lens, captured):
    """A Captured with the overscan that a lens needs, and a line about the pixels that were repeated for it."""
    radiance, layers = captured.radiance, captured.layers
    needed = field_map(lens).overscan_px(radiance.grid, radiance.wavelengths_nm, 0)
    missing = _missing(needed, radiance.grid)
    if not any(missing):
        return captured, ""
    if layers and any(margin := _missing(needed, layers.grid.on_sensor())):
        layers = extended_layers(layers, margin)
    planes = {name: replace(plane, values=extended_plane(plane.values, missing))
              for name, plane in captured.planes.items()}
    region = captured.region if captured.region is None else extended_plane(captured.region, missing)
    extended = replace(captured, radiance=extended_image(radiance, missing), planes=planes, region=region,
                       layers=layers)
    return extended, (f"{lens.name} shows {max(missing)} px more beyond the frame than was captured: the edge is "
                      "repeated there; render again for the scene's own light")


def _lacking(lens, stored, request):
    """A remark if the overscan lacks light that the lens spreads into the frame; "" otherwise."""
    lens, radiance = _fit(lens, stored, request.view)
    reach_px = cached_plan(request.options, lens, radiance.sampling).reach_px
    needed = field_map(lens).overscan_px(radiance.grid, radiance.wavelengths_nm, reach_px)
    lacking = _exceeds(needed, radiance.grid.overscan_px)
    return "; the border will lack light from beyond the capture" if lacking else ""


def _exceeds(needed_px, available_px):
    return any(needed > available for needed, available in zip(needed_px, available_px, strict=True))


def _check_region(lens, captured, options, path):
    """Raise an ImageError if a lens needs light around the render region that was not captured."""
    if captured.region is None:
        return
    grid = captured.radiance.grid
    sides = _picture_sides(captured)
    region = [_moved(side, -overscan) for side, overscan in zip(sides, grid.overscan_px, strict=True)]
    if not captured.region[captured_region(region, lens, captured.radiance.wavelengths_nm, grid, options)].all():
        raise ImageError(path, "render region", "{1} x {0} px".format(*(side.stop - side.start for side in sides)),
                         f"{lens.name} needs more light from around it than was captured: render again through it")


def _outside_warning(captured, request):
    """A line if stray light lacks the sources beyond the picture; "" otherwise."""
    if captured.outside is not None or not request.stray.parts(request.options.accuracy or DEFAULT_ACCURACY):
        return ""
    return ("stray light from beyond the picture is missing, because the radiance was rendered without Stray Light: "
            "render again with it")


def _blur_warning(lens, captured, iris):
    """A line if blur needs light from beyond the edge of a captured layer; "" otherwise."""
    layers, lacking, reach = captured.layers, [0.0], opening(iris, lens).reach / 2
    for layer in layers.layers if layers else ():
        rows, columns = (np.arange(side.start, side.stop) for side in layer.place)
        in_focus = focus_in_capture(lens, layers.capture, rows[:, None], columns)
        blur_of_layer = np.abs(blur_px(lens, layers.grid.pitch_um, layer.depth_mm, in_focus))
        blur = np.where(layer.alpha > 0, blur_of_layer * reach, 0)
        for axis, (place, shown, parts) in enumerate(zip(layer.place, _shown(captured), (1, layers.grid.across),
                                                         strict=True)):
            ends = (shown.start - place.start, blur.take(0, axis)), (place.stop - shown.stop, blur.take(-1, axis))
            lacking += [blurs.max() - beyond / parts for beyond, blurs in ends if beyond >= 0 and blurs.any()]
    if max(lacking) < 1:
        return ""
    return (f"the blur of {lens.name} needs light from {max(lacking):.0f} px beyond the captured area: render again")


def _shown(captured):
    """Rows and columns of the layers' grid that the picture shows: the frame, or the render region in it."""
    shown = [_moved(side, before - overscan)
             for side, overscan, before in zip(_picture_sides(captured), captured.radiance.overscan_px,
                                               captured.layers.sampling.grid.overscan_px, strict=True)]
    return finer_region(shown, 1, captured.layers.grid.across)


def _picture_sides(captured):
    """Rows and columns of the radiance's grid that the picture shows: the frame, or the render region in it."""
    if captured.region is None:
        return [slice(overscan, overscan + n)
                for overscan, n in zip(captured.radiance.overscan_px, captured.radiance.frame_px, strict=True)]
    return covered(captured.region == 1)


def _moved(side, px):
    return slice(side.start + px, side.stop + px)


def _layers_text(captured):
    count = len(captured.layers.layers) if captured.layers else 0
    return f"blurred by depth, in {count} captured layer{'s' * (count > 1)}" if count else ""


def _facts(lens, captured, warning, result):
    """The report's part about the radiance file."""
    radiance = captured.radiance
    needed = field_map(lens).overscan_px(radiance.grid, radiance.wavelengths_nm, result.report.lens_image.plan.reach_px)
    return FileFacts(str(result.radiance), needed, None, warning, captured.depth_check(lens), _layers_text(captured))
