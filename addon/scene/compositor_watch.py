"""Keeps the compositor's Lensfield nodes up to date as the scene changes, and as files appear and disappear.

In a window, changes are detected immediately, and changes that Blender does not announce (settings, files) within
CHECK_S. In any case the scene is compared once more when a render begins, as its compositor then decides what to show.
A script renders on the main thread, where the tree can be edited. F12 in a window renders on one of Blender's threads:
there the comparison only reads, like the render itself, and overwrites values of existing keyframes.
"""

import time

import bpy
from bpy.app.handlers import persistent

from lensfield.engine.runtime.threads import in_main_thread

from .compositor import forget_fingerprints, has_lens_images, is_true, refresh, relabel, rewrite_switches
from .fingerprint import changed, forget, forget_all, forget_unannounced, is_known, settings_digest

CHECK_S = 1.0
QUIET_S = 0.5  # after a change, such as one of many strokes: older changes can wait

_settings = {}  # by session_uid: digests of the scenes' settings at the last check; empty if more may have changed
_last = {"update_s": 0.0}


def look_again():
    """Compare the scenes with their lens images, and switch their nodes accordingly."""
    forget_fingerprints()
    for scene in _watched():
        refresh(scene)


@persistent
def on_update(scene, depsgraph):
    """React to a change: immediately if lens images are current, or may be again after an undo."""
    blocks, known = _updated(depsgraph), [is_true(scene) for scene in _watched()]
    _last["update_s"] = time.monotonic()
    if any(known) and not _renders():
        if any([changed(block) for block in blocks if is_known(block)]):
            look_again()
        elif not all(map(is_known, blocks)):  # new, or forgotten during a render: `check` or the next render compares
            _settings.clear()
        return
    _forget(blocks)
    if None in known and not _renders():
        look_again()


@persistent
def on_undo(*_):
    """Forget fingerprints: data-blocks are replaced, and Blender then announces which of them differ."""
    forget_fingerprints()


@persistent
def on_load(*_):
    """Start from scratch with another file."""
    forget_all()
    look_again()


@persistent
def on_render(scene, *_):
    """A script renders, and Blender may not know its changes yet. Lensfield's own passes do not use the compositor."""
    if scene.render.use_compositing and in_main_thread():
        forget_all()
        look_again()


@persistent
def on_frame_render(scene, *_):
    """F12 renders a frame: afterwards, Blender evaluates a copy of the scene for the compositor."""
    if scene.render.use_compositing and not in_main_thread() and has_lens_images(scene):
        forget_unannounced()
        forget_fingerprints()
        rewrite_switches(scene)
        _settings.clear()


@persistent
def on_frame(scene, depsgraph):
    """Update the label, which names the frame. Animated blocks have changed; `check` finds other changes later. A
    render updates every block of its own copy of the scene, which means nothing here."""
    if _renders():
        return
    _forget(_updated(depsgraph))
    if has_lens_images(scene):
        refresh(scene)


def check():
    """Check for changes that Blender does not announce; returns the seconds to the next check."""
    if _renders():
        for scene in _watched():
            relabel(scene)
    elif not _plays():
        quiet = time.monotonic() - _last["update_s"] > QUIET_S
        for scene in _watched():
            settings = settings_digest(scene)
            if quiet and settings != _settings.get(scene.session_uid):
                _settings[scene.session_uid] = settings
                forget_fingerprints()
            refresh(scene)
    return CHECK_S


def _watched():
    return [scene for scene in bpy.data.scenes if has_lens_images(scene)]


def _forget(blocks):
    """Compare these data-blocks again at the next check."""
    for block in blocks:
        forget(block)
    if blocks:
        _settings.clear()


def _updated(depsgraph):
    blocks = [update.id.original for update in depsgraph.updates] if depsgraph else []
    return [block for block in blocks if not block.is_embedded_data]


def _plays():
    return any(window.screen.is_animation_playing for window in bpy.context.window_manager.windows)


def _renders():
    return bpy.app.is_job_running("RENDER")


_HANDLERS = {"depsgraph_update_post": on_update, "undo_post": on_undo, "redo_post": on_undo, "load_post": on_load,
             "render_init": on_render, "render_pre": on_frame_render, "frame_change_post": on_frame}


def start_watching():
    """Register the handlers, until `stop_watching`."""
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    if not bpy.app.background:
        bpy.app.timers.register(check, first_interval=CHECK_S, persistent=True)


def stop_watching():
    """Remove the handlers."""
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    if bpy.app.timers.is_registered(check):
        bpy.app.timers.unregister(check)
