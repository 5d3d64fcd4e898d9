"""Requirements on a scene for any lens render: checked by the window, by preflight and by the render itself.

The checks read settings only. They take microseconds, so a panel can run them each time it is drawn.
"""

from math import inf

import bpy

from .active_camera import camera_settings
from .camera import check_camera, frame_px, render_region
from .errors import SceneError
from .lens_facts import squeeze_of
from .linked import check_editable
from .motion import camera_at

LEAST_PX = 4  # Blender renders no smaller side, whatever the resolution says


def check_scene(scene, *, frames=(), view_layer=None, view=None, output_folder=None, lens=None, **_):
    """Raise a SceneError for the first reason why the scene cannot be rendered through a lens.

    Parameters
    ----------
    scene : bpy.types.Scene
    frames : iterable of int
        Frames to render: checks all cameras that markers bind to them. Without frames, the active camera.
    view_layer, view, output_folder, lens, ... : by name
        Fields of a RenderRequest; by default the settings of the scene and of the cameras.
    """
    check_editable(scene, "open that file, or append the scene instead")
    if output_folder is None:
        _check_file_names(scene)
    cameras = dict.fromkeys(camera_at(scene, frame) for frame in frames) or [scene.camera]
    for camera in cameras:
        settings = camera_settings(scene, camera)
        check_camera(scene, settings.chosen_view() if view is None else view, camera)
        _check_pixels(scene, settings, lens)
    if not 0 < scene.unit_settings.scale_length < inf:
        raise SceneError(f"scene {scene.name!r}", "unit scale", f"{scene.unit_settings.scale_length:g}",
                         "expected a positive number: set it in the scene properties, under Units")
    rows, columns = frame_px(scene)
    if min(rows, columns) < LEAST_PX:
        raise SceneError(f"scene {scene.name!r}", "resolution", f"{columns} x {rows} px",
                         f"expected at least {LEAST_PX} px on each side")
    if scene.background_set:
        raise SceneError(f"scene {scene.name!r}", "background set", scene.background_set.name,
                         "link its collections into this scene instead")
    _check_view_layers(scene, scene.lensfield.view_layer if view_layer is None else view_layer)
    render_region(scene)


def _check_pixels(scene, settings, lens):
    """Raise a SceneError for pixels that are not square, unless the lens is anamorphic."""
    render = scene.render
    if render.pixel_aspect_x == render.pixel_aspect_y:
        return
    lens = settings.lens_name_or_path() if lens is None else lens
    if not lens or squeeze_of(lens) == 1:
        raise SceneError(f"scene {scene.name!r}", "pixel aspect",
                         f"{render.pixel_aspect_x:g}:{render.pixel_aspect_y:g}",
                         "expected square pixels, as the lens is not anamorphic: set both sides of Aspect to 1 in the "
                         "output properties")


def _check_file_names(scene):
    """Raise a SceneError if the files of another scene have the same names, in file systems that may ignore case."""
    def files(scene):
        return scene.lensfield.output_folder, bpy.path.clean_name(scene.name).casefold()

    for other in bpy.data.scenes:
        if other != scene and other.is_editable and files(other) == files(scene):
            raise SceneError(f"scene {scene.name!r}", "name", f"like that of scene {other.name!r} in file names",
                             "rename one of the scenes, or give them different output folders")


def _check_view_layers(scene, chosen):
    names = [layer.name for layer in scene.view_layers]
    if chosen and chosen not in names:
        raise SceneError(f"scene {scene.name!r}", "view layer", chosen, f"expected {' or '.join(names)}")
    on = [layer.name for layer in scene.view_layers if layer.use]
    if not chosen and len(on) != 1:
        raise SceneError(f"scene {scene.name!r}", "view layers for rendering", ", ".join(on) or "none",
                         "choose one with View Layer in Lensfield's settings, or with --view-layer")
