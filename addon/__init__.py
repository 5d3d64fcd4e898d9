"""The Blender side: panels, operators, the multispectral render and the compositor step."""

import bpy

from lensfield.engine.runtime.cache import set_cache_folder

from ..request import RenderRequest
from .job.job import check_output_folder, folder_for, set_blend_folder
from .job.photo import camera_words
from .job.result import check_next_to_frames
from .job.source import source_digest
from .render.animation import Animation, frames_of, render_animation
from .render.cameras import frame_camera
from .render.child import sweep
from .render.comparison import plan_comparison, render_comparison
from .render.dataset import Dataset, render_dataset
from .render.preflight import preflight
from .render.refilter import apply_lens
from .render.render import render_through_lens, shared_cache
from .render.scene_preview import changed_scene, moved_preview, open_preview, opened_preview
from .render.session import take_session
from .scene.active_camera import camera_settings
from .scene.compositor_watch import start_watching, stop_watching
from .scene.lens_cache import forget_lenses
from .scene.trust import forget_trust
from .ui import (
    animation,
    another_lens,
    camera_presets,
    comparison,
    compositor_panel,
    favourites,
    fit_lens,
    fixes,
    lens_assets,
    lint_panel,
    old_files,
    open_lens,
    open_measured,
    operators,
    panels,
    plan_line,
    sheets,
    spectra_panels,
    trust_panel,
    window_render,
)
from .ui.common import lens_worker, preferences, properties
from .ui.common.background import forget_work
from .ui.common.previews import forget_previews
from .ui.keys import register_keys, unregister_keys
from .ui.live import live, quick_look
from .ui.preview import click_focus, preview, preview_panel

__all__ = ["Animation", "Dataset", "RenderRequest", "apply_lens", "camera_settings", "camera_words", "changed_scene",
           "check_next_to_frames", "check_output_folder", "folder_for", "frame_camera", "frames_of", "moved_preview",
           "open_preview", "opened_preview", "plan_comparison", "preflight", "register", "render_animation",
           "render_comparison", "render_dataset", "render_through_lens", "set_blend_folder", "source_digest",
           "take_session", "unregister"]

_MODULES = (properties, preferences, favourites, fixes, operators, open_lens, open_measured, fit_lens, animation,
            another_lens, comparison, preview_panel, live, quick_look, lens_assets, compositor_panel, camera_presets,
            click_focus, panels, lint_panel, spectra_panels, trust_panel)
_CLASSES = [cls for module in _MODULES for cls in module.classes]
for _operator in (cls for cls in _CLASSES if issubclass(cls, bpy.types.Operator)):
    _operator.bl_description = " ".join(_operator.__doc__.split())  # tooltips show line breaks
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(_CLASSES)


def register():
    """Register classes and properties, and remove files that a killed Blender left behind."""
    _set_cache_folder()
    _register_classes()
    preferences.follow_gpu()
    properties.register_pointers()
    old_files.start()
    register_keys()
    sweep()
    start_watching()
    quick_look.start_following()
    bpy.app.handlers.load_post.append(window_render.forget_last)


def _set_cache_folder():
    """Put the engine's cache into the folder that Blender reserves for an extension, if this is one."""
    package = __package__.rpartition(".")[0]
    if package.startswith("bl_ext."):
        set_cache_folder(bpy.utils.extension_path_user(package, path="cache"))


def unregister():
    """Undo `register`. Blender also calls it on exit."""
    window_render.end()
    preview.end()
    live.end()
    stop_watching()
    quick_look.stop_following()
    bpy.app.handlers.load_post.remove(window_render.forget_last)
    old_files.stop()
    plan_line.plans.forget()
    unregister_keys()
    properties.unregister_pointers()
    _unregister_classes()
    shared_cache.cache_clear()
    lens_worker.forget_requests()
    forget_work()
    sheets.forget_sheets()
    forget_lenses()
    forget_trust()
    forget_previews()
    properties.forget_items()
