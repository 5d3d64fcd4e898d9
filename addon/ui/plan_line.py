"""The line that tells, before a render, what it will take; the engine's part of it is worked out in a thread."""

from concurrent.futures import ThreadPoolExecutor

import bpy
import numpy as np

from ...engine.image.spectral_image import SpectralImage
from ...engine.plan.remembered import remembered_plan
from ..job.bands import pass_count
from ..job.radiance import pass_bytes
from ..scene.camera import frame_capture, frame_px, lens_for_view
from . import lint_panel
from .window_render import areas

TICK_S = 0.1

MOST_PLANS = 4  # two windows draw theirs in turn

_worker = ThreadPoolExecutor(1, "Lensfield plan")
_plans = {}  # of what was asked for last, the newest at the end


def plan_text(scene, lens):
    """What rendering a scene by its settings through a lens, as large as it is itself, will take, in one line; it
    changes nothing and waits for nothing.

    Raises
    ------
    InputError
        What the settings ask for cannot be.
    """
    settings = scene.lensfield
    wavelengths_nm = settings.wavelengths_nm()
    lens = lens_for_view(scene, lens, settings.view.lower())[0]
    (rows, columns), future = _planned(settings.to_options(), lens, frame_px(scene), tuple(wavelengths_nm))
    samples = scene.cycles.samples
    text = (f"{_renders(scene, len(wavelengths_nm))} of {columns} x {rows} px, {samples} sample{'s' * (samples > 1)}; "
            f"{len(wavelengths_nm)} wavelengths")
    if not future.done() or future.exception():  # it is being made, or there can be none
        return text
    plan = future.result()
    light_mb = 4e-6 * rows * columns * len(wavelengths_nm)
    pass_mb = 1e-6 * pass_bytes(rows * columns, 1, settings.denoises(settings.to_spectral_options()))
    memory_mb = light_mb + max(pass_mb, plan.memory_mb + light_mb)  # of the radiance, and at last of the irradiance
    memory = f"{memory_mb / 1e3:.1f} GB" if memory_mb >= 1e3 else f"{memory_mb:.0f} MB"
    return f"{text}; then {max(plan.seconds, 0.1):.1f} s for the lens; {memory} beside the scene"


def _renders(scene, wavelengths):
    """How many Cycles renders it takes, as far as is known."""
    most, tier = pass_count(wavelengths), scene.lensfield.tier
    checked = lint_panel.checked
    if checked["scene"] == scene.session_uid and checked["found"].plan and checked["asked"] == lint_panel.asked(scene):
        known, slabs = len(checked["found"].plan.bands), checked["found"].slabs
        return f"{known} Cycles render{'s' * (known > 1)}" + (f" in {slabs.slabs} slabs of depth" if slabs else "")
    if tier == "PREVIEW" or most == 1:
        return "1 Cycles render"
    return f"{most} or more Cycles renders" if tier == "REFERENCE" else f"1 to {most} Cycles renders"


def _planned(options, lens, frame_shape_px, wavelengths_nm):
    """Rows and columns of the capture, and a Future of the engine's plan; worked out once, as panels are drawn many
    times a second."""
    asked = options, lens, frame_shape_px, wavelengths_nm
    if asked not in _plans:
        grid = frame_capture(lens, frame_shape_px, wavelengths_nm)
        dark = np.broadcast_to(np.float32(0), (len(wavelengths_nm), *grid.shape_px))
        if len(_plans) == MOST_PLANS:
            _plans.pop(next(iter(_plans)))[1].cancel()  # a slider that is dragged asks for many
        plan = _worker.submit(remembered_plan, options, lens, SpectralImage(dark, wavelengths_nm, grid))
        _plans[asked] = grid.shape_px, plan
        if not bpy.app.background:
            bpy.app.timers.register(lambda: _redraw_when_done(plan), first_interval=TICK_S)
    return _plans[asked]


def _redraw_when_done(plan):
    if not plan.done():
        return TICK_S
    for area in areas("PROPERTIES", "VIEW_3D"):
        area.tag_redraw()
    return None


def forget_plans():
    """Free them."""
    _plans.clear()
