"""Keeps the compositor's Lensfield nodes true: a scene that changes, and files that come and go.

All is done on the main thread, while nothing renders. In a window, changes are seen as they are made, and what Blender
does not tell of (settings, files) within CHECK_S; in the background, when a render begins.
"""

import time

import bpy
from bpy.app.handlers import persistent

from .compositor import forget_fingerprints, has_lens_images, is_true, refresh
from .fingerprint import changed, forget, forget_all, settings_digest

CHECK_S = 1.0
QUIET_S = 0.5  # after a change, such as a stroke of many: what is old by then can wait

_settings = {}  # by session_uid: the scenes' settings as last seen; none, where more may have changed
_last = {"update_s": 0.0}


def look_again():
    """Compare the scenes with their lens images, and switch their nodes by what is found."""
    forget_fingerprints()
    for scene in _watched():
        refresh(scene)


@persistent
def on_update(scene, depsgraph):
    """Something has changed. Where lens images are true, or may be so again by an undo, it is looked at at once."""
    blocks, known = _updated(depsgraph), [is_true(scene) for scene in _watched()]
    _last["update_s"] = time.monotonic()
    if any(known) and not _renders():
        if any([changed(block) for block in blocks]):
            look_again()
        return
    _forget(blocks)
    if None in known and not _renders():
        look_again()


@persistent
def on_undo(*_):
    """What was looked at is other data now; Blender tells by an update which of it differs."""
    forget_fingerprints()


@persistent
def on_load(*_):
    """Another file."""
    forget_all()
    look_again()


@persistent
def on_render(scene, *_):
    """In the background no timer looks before a render; our own passes do without the compositor."""
    if bpy.app.background and scene.render.use_compositing:
        forget_all()
        look_again()


@persistent
def on_frame(scene, depsgraph):
    """The label tells of the frame. What is animated is another; what else has changed is looked for by and by."""
    _forget(_updated(depsgraph))
    if not _renders() and has_lens_images(scene):
        refresh(scene)


def check():
    """Look at what Blender does not tell of; seconds to the next look."""
    if not _renders() and not _plays():
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
    """Look at them again at the next check."""
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
             "render_init": on_render, "frame_change_post": on_frame}


def start_watching():
    """Until `stop_watching`."""
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    if not bpy.app.background:
        bpy.app.timers.register(check, first_interval=CHECK_S, persistent=True)


def stop_watching():
    """As it was."""
    for name, handler in _HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    if bpy.app.timers.is_registered(check):
        bpy.app.timers.unregister(check)
