"""Pictures of a scene: by Cycles alone, and by Lensfield through a nearly perfect lens.

The lens is a thin lens without aberrations, distortion, falloff or absorption, whose points are much smaller than a
pixel. In layers, it blurs like Cycles' own depth of field with the same pupil and focus. Lensfield's pictures should
therefore equal Cycles' own, except for the noise, and for the error of colours predicted from few wavelengths.
"""

from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
import OpenEXR
from bpy_extras.object_utils import world_to_camera_view

from lensfield import addon
from lensfield.addon.scene.camera import frame_px
from lensfield.addon.scene.units import metres_per_unit
from lensfield.commands.terminal import quiet
from lensfield.engine.lens import RadialLens
from lensfield.engine.spectral.refraction import load_refraction
from lensfield.engine.spectral.spectra import CHANNEL_NM
from lensfield.engine.stray.options import StrayOptions
from scenes.kit import curves_of

NARROW_PX, WIDE_PX = 0.02, 2.5  # blur at infinity, sharp and in layers
BAND_NM = 380.0, 780.0
ANY_LENS = "tessar-50mm"
LAST = 3.0  # field of the lens, in half diagonals of its sensor: for shifts


@dataclass(frozen=True)
class PlainRender:
    """What a plain render changes in the artist's file, in addition to its seed.

    Attributes
    ----------
    compositing : bool
        Whether the scene's compositor is used.
    view_layer : str
        The only view layer to be rendered; "" to keep the file's choice.
    marks : bool
        Whether the camera sees the marks.
    """

    compositing: bool = False
    view_layer: str = ""
    marks: bool = True


def plain_picture(path, folder, seed, blur_px=0.0, changes=PlainRender()):
    """A file as Cycles renders it: float array (4, row, column) of R, G, B and alpha in linear Rec. 709.

    Pixels average the light over their own squares, as Lensfield's do and its report says, instead of Blender's filter.
    """
    scene = open_scene(path)
    render, cycles = scene.render, scene.cycles
    set_seed(scene, seed)
    cycles.pixel_filter_type = "BOX"
    render.engine, render.use_compositing = "CYCLES", changes.compositing
    for name in ("use_sequencer", "use_stamp", "use_crop_to_border", "use_multiview", "use_freestyle"):
        setattr(render, name, False)  # Lensfield ignores them, and remarks on them
    for layer in scene.view_layers if changes.view_layer else ():
        layer.use = layer.name == changes.view_layer
    if not changes.marks:
        hide_marks(scene)
    _set_blur(scene, blur_px)
    return _dispersed(scene, folder / "plain.exr")


def _dispersed(scene, path):
    """The same as `rendered`, with the index that glass of an assigned refraction has at each channel's wavelength."""
    glass = [(material.node_tree.nodes["Principled BSDF"].inputs["IOR"], load_refraction(material.lensfield.refraction))
             for material in bpy.data.materials if material.lensfield.refraction]
    planes = []
    for nm in CHANNEL_NM if glass else ():
        for socket, refraction in glass:
            socket.default_value = refraction.n_at(nm)
        planes.append(rendered(scene, path))
    return np.stack([*(plane[n] for n, plane in enumerate(planes)), planes[0][3]]) if glass else rendered(scene, path)


def set_seed(scene, seed):
    """Set the seed of a scene, which many files animate by a driver or keyframes."""
    animation = scene.animation_data
    for curve in [*animation.drivers, *curves_of(animation.action)] if animation else ():
        curve.mute |= curve.data_path == "cycles.seed"
    scene.cycles.seed = seed


def rendered(scene, path):
    """Render a scene to an EXR and read it: float array (4, row, column)."""
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):  # added in 5.0
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGBA"
    settings.color_management = "OVERRIDE"  # otherwise the file is in the working space
    settings.linear_colorspace_settings.name = "Linear Rec.709"
    scene.render.use_file_extension, scene.render.filepath = False, str(path)
    with quiet(1):
        bpy.ops.render.render(write_still=True, scene=scene.name)
    return read_picture(path)


def read_picture(path):
    """R, G, B and alpha of an EXR: float array (4, row, column); alpha is 1 without that channel."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.parts[0].channels
        planes = [np.asarray(channels[name].pixels, float) for name in "RGBA" if name in channels]
    return np.stack(planes if len(planes) == 4 else [*planes, np.ones_like(planes[0])])


def open_scene(path):
    """The scene of a .blend."""
    with quiet(1):
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False)
    return bpy.context.scene


def _set_blur(scene, blur_px):
    """Turn Cycles' depth of field on, with this blur at infinity, or off."""
    dof = scene.camera.data.dof
    dof.use_dof = blur_px > 0
    if dof.use_dof:
        lens = thin_lens(scene, blur_px)
        dof.aperture_blades, dof.aperture_ratio = 0, 1.0
        pupil_mm = lens.capture_focal_length_mm / lens.f_number_effective
        dof.aperture_fstop = scene.camera.data.lens * metres_per_unit(scene) / pupil_mm


def thin_lens(scene, blur_px):
    """A perfect thin lens with the field of view and focus of the scene's camera, and this blur at infinity."""
    focal_mm, focus_mm = scene.camera.data.lens, focus_units(scene) * metres_per_unit(scene) * 1e3
    rows, columns = frame_px(scene)
    pitch_mm = _pitch_mm(scene.camera.data, rows, columns)
    sensor_mm = columns * pitch_mm, rows * pitch_mm
    pupil_mm = blur_px * pitch_mm * focus_mm / focal_mm
    last_mm = LAST * np.hypot(*sensor_mm) / 2
    nm, heights_mm = np.array(BAND_NM), np.linspace(0, last_mm, 5)
    ones = np.ones((2, 5))
    sine = np.sin(np.arctan(pupil_mm / 2 / focus_mm)) * focus_mm / focal_mm
    return RadialLens(
        name="thin lens", efl_mm=1 / (1 / focal_mm + 1 / focus_mm), magnification=-focal_mm / focus_mm,
        f_number_effective=0.5 / sine, object_distance_mm=focus_mm, entrance_pupil_mm=0.0, sensor_mm=sensor_mm,
        reference_wavelength_nm=550.0, wavelengths_nm=nm, heights_mm=heights_mm, real_height_mm=heights_mm * ones,
        relative_illumination=ones, psf=np.ones((2, 5, 1, 1)), psf_pitch_um=1e-3 * pitch_mm,
        enclosed_energy=ones, transmittance=np.ones(2))


def _pitch_mm(camera, rows, columns):
    """Side of a pixel on the sensor of a perspective camera, by its Sensor Fit."""
    if camera.sensor_fit == "VERTICAL":
        return camera.sensor_height / rows
    return camera.sensor_width / (columns if camera.sensor_fit == "HORIZONTAL" else max(rows, columns))


def focus_units(scene):
    """Distance of the plane of focus from the scene's camera, along its axis, in Blender units."""
    camera, dof = scene.camera, scene.camera.data.dof
    if dof.focus_object is None:
        return dof.focus_distance
    return abs((camera.matrix_world.inverted() @ dof.focus_object.matrix_world.translation).z)


@dataclass(frozen=True, eq=False)
class LensPicture:
    """What Lensfield makes of a scene.

    Attributes
    ----------
    picture : array (4, row, column)
    report : Report
    """

    picture: np.ndarray
    report: object


def lens_picture(path, folder, seed, blur_px, depth, compositing=False, **request):
    """A file as Lensfield renders it through the thin lens: LensPicture."""
    scene = open_scene(path)
    set_seed(scene, seed)
    lens = thin_lens(scene, blur_px or NARROW_PX) if scene.camera else ANY_LENS
    given = {"lens": lens, "view": "camera", "depth": depth, "output_folder": folder,
             "stray": StrayOptions("off")}
    with quiet(1):
        result = addon.render_through_lens(scene, to_compositor=compositing, **given | request)
    shown = read_picture(result.lens_image) if not compositing else rendered(scene, folder / "composited.exr")
    return LensPicture(shown, result.report)


def marks_of(scene):
    """The marks of a scene: list of objects."""
    return [each for each in scene.objects if each.name.startswith("Mark")]


def hide_marks(scene):
    """Hide the marks from the camera; their light stays."""
    for mark in marks_of(scene):
        mark.visible_camera = False


def marks_px(path):
    """Places of the marks in a file's camera, by name: (row, column) in pixels from the upper left."""
    scene = open_scene(path)
    rows, columns = frame_px(scene)
    if scene.camera is None:
        return {}
    graph = bpy.context.evaluated_depsgraph_get()
    places = {}
    for mark in marks_of(scene):
        view = world_to_camera_view(scene, scene.camera.evaluated_get(graph),
                                    mark.evaluated_get(graph).matrix_world.translation)
        places[mark.name] = ((1 - view.y) * rows - 0.5, view.x * columns - 0.5)
    return places


@contextmanager
def registered():
    """Lensfield, registered in this Blender."""
    addon.register()
    yield
    addon.unregister()
