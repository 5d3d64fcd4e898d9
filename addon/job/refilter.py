"""Another lens on a picture: the radiance that a render has kept, put through a lens again, without Cycles.

The kept picture has its field of view. Another lens takes that on a sensor of another size than its own; or, for the
camera's view, is made as large as the sensor that there is takes.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ...engine import ImageError, InputError, Lens, Options
from ...engine.bake.rings import AT_REST, resized_rings
from ...engine.errors import absence
from ...engine.field.overscan import VIEWS, overscan_px
from ...engine.files import check_target, discard
from ...engine.image.depth_range import AUTO, OFF, blur_px
from ...engine.image.layers import covered
from ...engine.image.pitch import fitting_pitch_um
from ...engine.image.spectral_exr import read_parts, read_with_layers, read_with_planes
from ...engine.library import cannot_be, has_rings, iris_shows, prescription_of
from ...engine.report import FileFacts
from ..scene.camera import captured_region, covered_diagonal, frame_px, size_warning
from ..scene.lens_cache import load_lens, scaled_lens
from .job import check_output_folder, folder_for
from .pictures import REGION
from .radiance import Captured
from .remarks import ROUND_BLUR
from .render import Result, lens_steps, run
from .steps import Work

APPLIED_DEPTHS = AUTO, OFF
BY_RESULT = Options()
SAME = 0.005  # of its own sensor's size, within which a lens is taken to have its own view


def apply_lens(radiance, lens, output_folder=None, *, options=BY_RESULT, view="lens", rings=AT_REST,
               iris=None, lens_quality="standard", depth=AUTO, progress=None):
    """Put the radiance that a render has kept through another lens, or the same one otherwise; all files are made anew.

    Parameters
    ----------
    radiance : path
        Such as Scene_0001_radiance.exr, as `render_through_lens` left it.
    lens : Lens, or a name or path that `Lens.load` takes
    output_folder : path, optional
        Where the files are to lie; by default beside the radiance, in place of those that were there.
    options : Options
    view : "lens" or "camera"
        Whether the lens stays as large as it is, the kept field of view on its sensor; or is made as large as that
        takes on the sensor that the picture was rendered for. The picture is the same.
    rings : Rings
        What a lens that is given by name or path is turned to.
    iris : Iris, optional
        The blades that stop it down: they count below its widest f-stop, for what is out of focus.
    lens_quality : str
        How finely it is baked.
    depth : "auto" or "off"
        Whether the layers of depth that the radiance may have are used: then any focus and f-stop is as if it had been
        rendered so.
    progress : callable (fraction, label), optional

    Returns
    -------
    Result

    Raises
    ------
    LensError, ImageError, InputError
        Among others where the lens needs more than was captured: it takes a new render then.
    """
    return run(_steps(Path(radiance), lens, output_folder, options, view, rings, iris, lens_quality, depth), progress)


def kept_radiance(scene):
    """The file of the light that a scene's render has kept, for its current frame and by its settings.

    Raises
    ------
    InputError
        There is none, or the scene's pictures are of another size by now.
    """
    check_output_folder(scene)
    path = Result.of(scene, folder_for(scene), scene.frame_current).radiance
    if not path.is_file():
        raise InputError(path, "light of a render", absence(path), "render through the lens first")
    (left, top), (right, bottom) = read_parts(path, header_only=True)[0][0]["displayWindow"]
    size, rows_columns = (bottom - top + 1, right - left + 1), frame_px(scene)
    if size != rows_columns:
        raise InputError(path, "size", "{1} x {0} px".format(*size),
                         "the scene's is {1} x {0} px now: render again".format(*rows_columns))
    return path


def applied_depth(settings):
    """What a scene's settings have `apply_lens` do of depth: layers that are there are used, but where it is off."""
    return OFF if settings.depth == OFF.upper() else AUTO


def _steps(path, lens, output_folder, options, view, rings, iris, quality, depth):
    for name, value, choices in (("view", view, VIEWS), ("depth", depth, APPLIED_DEPTHS)):
        if value not in choices:
            raise InputError("options", name, value, f"expected {' or '.join(choices)}")
    result = replace(Result.beside(path, "radiance", output_folder), radiance=path)
    result.report.files["radiance"] = str(path)
    for file in (file for file in result.files if file != path):
        check_target(file)
    with result.report.stage("read radiance"):
        captured = yield Work(lambda tell: _read(path, depth, result.irradiance.parent), "Reading radiance", 0.0)
    words = ()
    if not isinstance(lens, Lens):
        iris = iris if iris_shows(lens, rings) else None
        lens, words = yield Work(lambda tell: _turned(lens, rings, quality, view, captured), "Baking the lens", 0.05)
    lens, captured, warning = _fitted(lens, captured, view, path)
    if captured.layers and not lens.prescription:
        words = *words, f"{lens.name}: {ROUND_BLUR}"
    warning = "; ".join(filter(None, (*words, warning, _blur_warning(lens, captured))))
    _check_region(lens, captured, path)
    _check_overscan(lens, captured.radiance, path)
    discard(result.record)  # from here on it would tell of other files
    yield from lens_steps(captured, lens, options, iris, result, 0.1)
    result.report.file = _facts(lens, captured, warning, result)
    result.report.write(result.record)
    return result


def _read(path, depth, folder):
    layers = None
    if depth == AUTO:
        radiance, planes, layers = read_with_layers(path, scratch=folder)
    else:
        radiance, planes = read_with_planes(path, scratch=folder)
    if radiance.focal_mm is None or "Z" not in planes:
        raise ImageError(path, "lensfield:focalMm", "missing", "it is of an older Lensfield: render again")
    return Captured(radiance, planes["Z"], planes.get("A"), planes.get(REGION), layers)


def _turned(lens, rings, quality, view, captured):
    """The lens of a name or path, and what its rings cannot do."""
    if not has_rings(lens):
        return load_lens(lens, rings), ()
    if view == "camera":
        rings = resized_rings(prescription_of(lens), rings, captured.radiance.focal_mm)
    return load_lens(lens, rings, quality), cannot_be(lens, rings)


def _fitted(lens, captured, view, path):
    """The lens, and the radiance as it lies on its sensor: as the pinhole that captured it sees, pixel by pixel."""
    radiance = captured.radiance
    factor = radiance.focal_mm / lens.capture_focal_length_mm
    if view == "camera":
        rows_mm, columns_mm = (n * radiance.pitch_um * 1e-3 for n in radiance.frame_px)
        adapted = scaled_lens(lens, factor, (columns_mm, rows_mm))
        return adapted, captured, size_warning(lens, adapted, factor)
    pitch_um = radiance.pitch_um / factor
    radiance, layers = (light and replace(light, grid=replace(light.grid, pitch_um=pitch_um),
                                          focal_mm=lens.capture_focal_length_mm)
                        for light in (radiance, captured.layers))
    return lens, replace(captured, radiance=radiance, layers=layers), _sensor_warning(lens, radiance)


def _sensor_warning(lens, radiance):
    """One line that says what the kept field of view means for a lens; "" where it is the lens's own."""
    if abs(radiance.pitch_um / fitting_pitch_um(lens, radiance.frame_px) - 1) < SAME:
        return ""
    height_mm, width_mm = (n * radiance.pitch_um * 1e-3 for n in radiance.frame_px)
    covered = covered_diagonal(lens, (width_mm, height_mm))
    own_width_mm, own_height_mm = lens.sensor_mm
    return (f"the kept picture's view, through {lens.name}, is that of a sensor of {width_mm:.3g} x {height_mm:.3g} "
            f"mm, in place of its own of {own_width_mm:.3g} x {own_height_mm:.3g} mm; its field covers {covered:.0%} "
            "of the frame's diagonal; render again for the lens's own view")


def _check_overscan(lens, radiance, path):
    """Raise an ImageError where part of a lens's frame would stay black, for want of what it draws in from beyond."""
    grid, nm = radiance.grid, radiance.wavelengths_nm
    needed = overscan_px(lens, grid, nm, 0)
    if any(least > there for least, there in zip(needed, grid.overscan_px, strict=True)):
        raise ImageError(path, "overscan", "{1} x {0} px".format(*grid.overscan_px),
                         "{name} draws in {1} x {0} px from beyond the frame: render again through it".format(
                             *needed, name=lens.name))


def _check_region(lens, captured, path):
    """Raise an ImageError where light is missing around the render region that a lens brings in."""
    if captured.region is None:
        return
    grid = captured.radiance.grid
    sides = _picture_sides(captured)
    region = [_moved(side, -overscan) for side, overscan in zip(sides, grid.overscan_px, strict=True)]
    if not captured.region[captured_region(region, lens, captured.radiance.wavelengths_nm, grid)].all():
        raise ImageError(path, "render region", "{1} x {0} px".format(*(side.stop - side.start for side in sides)),
                         f"{lens.name} draws in more from around it than there is: render again through it")


def _blur_warning(lens, captured):
    """One line that says that layers end so close to the picture that their blur would bring in more; "" where none
    does."""
    layers, lacking = captured.layers, [0.0]
    for layer in layers.layers if layers else ():
        blur = np.where(layer.alpha > 0, np.abs(blur_px(lens, layers.grid.pitch_um, layer.depth_mm)) / 2, 0)
        for axis, (there, shown) in enumerate(zip(layer.place, _shown(captured), strict=True)):
            ends = (shown.start - there.start, blur.take(0, axis)), (there.stop - shown.stop, blur.take(-1, axis))
            lacking += [blurs.max() - beyond for beyond, blurs in ends if beyond >= 0 and blurs.any()]
    if max(lacking) < 1:
        return ""
    return (f"blur through {lens.name} would bring in light from {max(lacking):.0f} px farther out than was captured: "
            "render again")


def _shown(captured):
    """Rows and columns of the layers' grid that are a picture: the frame, or the render region in it."""
    return [_moved(side, before - overscan)
            for side, overscan, before in zip(_picture_sides(captured), captured.radiance.overscan_px,
                                              captured.layers.grid.overscan_px, strict=True)]


def _picture_sides(captured):
    """Rows and columns of the radiance's grid that are a picture: the frame, or the render region in it."""
    if captured.region is None:
        return [slice(overscan, overscan + n)
                for overscan, n in zip(captured.radiance.overscan_px, captured.radiance.frame_px, strict=True)]
    return covered(captured.region == 1)


def _moved(side, px):
    return slice(side.start + px, side.stop + px)


def _layers_text(captured):
    count = len(captured.layers.layers) if captured.layers else 0
    return f"blurred by depth, in {count} layer{'s' * (count > 1)} as they were captured" if count else ""


def _facts(lens, captured, warning, result):
    """What the report tells of the file."""
    radiance = captured.radiance
    needed = overscan_px(lens, radiance.grid, radiance.wavelengths_nm, result.report.lens_image.plan.reach_px)
    return FileFacts(str(result.radiance), needed, None, warning, captured.depth_check(lens), _layers_text(captured))
