"""The line that tells, before a render, what it will take; the engine's part of it is worked out in a thread."""

from concurrent.futures import ThreadPoolExecutor

import bpy
import numpy as np

from ...engine.image.spectral_image import SpectralImage
from ...engine.plan.choose import make_plan
from ..job.bands import pass_count
from ..scene.camera import capture_grid, lens_for_view
from ..scene.lens_cache import load_lens
from . import lint_panel
from .window_render import areas

TICK_S = 0.1

_worker = ThreadPoolExecutor(1, "Lensfield plan")
_planned = {"asked": None, "plan": None}  # the newest that was asked for alone: what it was, and a Future


def plan_text(scene):
    """What rendering a scene by its settings will take, in one line; it changes nothing and waits for nothing.

    Raises
    ------
    InputError
        What the settings ask for cannot be.
    """
    settings = scene.lensfield
    wavelengths_nm = settings.wavelengths_nm()
    lens = lens_for_view(scene, load_lens(settings.lens_name_or_path()), settings.view.lower())[0]
    grid = capture_grid(scene, lens, wavelengths_nm)
    rows, columns = grid.shape_px
    samples = scene.cycles.samples
    text = (f"{_renders(scene, len(wavelengths_nm))} of {columns} x {rows} px, {samples} sample{'s' * (samples > 1)}; "
            f"{len(wavelengths_nm)} wavelengths")
    plan = _plan(settings.to_options(), lens, grid, wavelengths_nm)
    if plan is None:
        return text
    memory_mb = plan.memory_mb + 2 * 4e-6 * rows * columns * len(wavelengths_nm)  # radiance and irradiance
    memory = f"{memory_mb / 1e3:.1f} GB" if memory_mb >= 1e3 else f"{memory_mb:.0f} MB"
    return f"{text}; then {max(plan.seconds, 0.1):.1f} s for the lens, {memory}"


def _renders(scene, wavelengths):
    """How many Cycles renders it takes, as far as is known."""
    most, tier = pass_count(wavelengths), scene.lensfield.tier
    checked = lint_panel.checked
    if checked["scene"] == scene.session_uid and checked["found"].plan and checked["asked"] == lint_panel.asked(scene):
        known = len(checked["found"].plan.bands)
        return f"{known} Cycles render{'s' * (known > 1)}"
    if tier == "PREVIEW" or most == 1:
        return "1 Cycles render"
    return f"{most} or more Cycles renders" if tier == "REFERENCE" else f"1 to {most} Cycles renders"


def _plan(options, lens, grid, wavelengths_nm):
    """The engine's plan, or None as long as it is being made, or where there can be none."""
    asked = options, lens, grid, tuple(wavelengths_nm)
    if _planned["asked"] != asked:
        if _planned["plan"]:
            _planned["plan"].cancel()
        dark = np.broadcast_to(np.float32(0), (len(wavelengths_nm), *grid.shape_px))
        _planned.update(asked=asked, plan=_worker.submit(make_plan, options, lens,
                                                             SpectralImage(dark, wavelengths_nm, grid)))
        if not bpy.app.background and not bpy.app.timers.is_registered(_redraw_when_done):
            bpy.app.timers.register(_redraw_when_done, first_interval=TICK_S)
    made = _planned["plan"]
    return made.result() if made.done() and not made.cancelled() and not made.exception() else None


def _redraw_when_done():
    if _planned["plan"] and not _planned["plan"].done():
        return TICK_S
    for area in areas("PROPERTIES", "VIEW_3D"):
        area.tag_redraw()
    return None


def forget_plan():
    """Let go of what is being worked out: the add-on is about to end."""
    if _planned["plan"]:
        _planned["plan"].cancel()
    _planned.update(asked=None, plan=None)
    if bpy.app.timers.is_registered(_redraw_when_done):
        bpy.app.timers.unregister(_redraw_when_done)
