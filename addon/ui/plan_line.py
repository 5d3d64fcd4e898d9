"""The cost of a render in one line, before it starts; a thread computes the engine's part."""

import math

from lensfield.engine.image.detail import splitting_bytes
from lensfield.engine.image.sampling import Sampling
from lensfield.engine.plan.plan_cache import cached_plan
from lensfield.engine.runtime.messages import duration

from ..capture.bands import pass_count
from ..capture.room import detail_bytes, pass_bytes
from ..capture.sampled_passes import detail_times
from ..job.job import denoises
from ..scene.camera import frame_capture, frame_grid, frame_px, lens_for_view
from .common.background import Answers
from .common.session import session
from .learned_time import expected_seconds
from .lint_panel import checked_settings

LEAST_S = 0.1
MOST_PLANS = 4  # enough for two windows that draw theirs in turn


def plan_text(scene, lens):
    """The cost of rendering a scene by its settings through an unscaled lens: Cycles passes, then the seconds and the
    memory that the lens takes; and all of the time, once a render of the scene has shown it.

    Does not change the scene and does not block: the engine's part is added once it is computed.

    Raises
    ------
    InputError
        The settings are invalid.
    """
    request = scene.lensfield.to_request(lens=lens)
    wavelengths_nm = request.wavelengths_nm
    lens = lens_for_view(scene, lens, request.view_on_sensor)[0]
    times = detail_times(scene, request, math.prod(frame_px(scene)))
    work = plans.to(request.options, lens, frame_grid(scene, lens), wavelengths_nm, times)
    text = _passes(scene, len(wavelengths_nm))
    if not work.done() or work.exception():  # the plan is not ready, or not possible
        return text
    (rows, columns), plan = work.result()
    pixels = rows * columns
    light_mb = 4e-6 * pixels * len(wavelengths_nm)
    pass_mb = 1e-6 * pass_bytes(pixels * times**2, 1, denoises(scene, request))
    filter_mb = plan.memory_mb + 1e-6 * splitting_bytes(pixels, plan.known)
    memory_mb = light_mb + 1e-6 * detail_bytes(pixels, times) + max(pass_mb, filter_mb + light_mb)  # and irradiance
    memory = f"{memory_mb / 1e3:.1f} GB" if memory_mb >= 1e3 else f"{memory_mb:.0f} MB"
    detail = " with detail" * (plan.known > 1)
    renders_s, lens_s = expected_seconds(scene, request, plan.seconds) or (0.0, max(plan.seconds, LEAST_S))
    total = f"About {duration(renders_s + lens_s)}: " if renders_s else ""
    text = f"{total}{text[0].lower() if total else text[0]}{text[1:]}"
    return f"{text}, then about {lens_s:.1f} s for the lens{detail} \u00b7 {memory} of memory"


def _checked(scene):
    """The result of the last scene check, if it has a plan and is valid for the settings."""
    check = session.check
    if check.scene_uid == scene.session_uid and check.result.plan and check.settings == checked_settings(scene):
        return check.result
    return None


def _passes(scene, wavelengths):
    """The number of Cycles passes as text: exact after a scene check, otherwise a range."""
    most, tier = pass_count(wavelengths), scene.lensfield.tier
    checked = _checked(scene)
    if checked:
        known, slabs = len(checked.plan.bands), checked.slabs
        return f"{known} render{'s' * (known > 1)}" + (f" of {slabs.slabs} layers" if slabs else "")
    if tier == "PREVIEW" or most == 1:
        return "1 render"
    return f"{most} or more renders" if tier == "REFERENCE" else f"Up to {most} renders"


def _plan(options, lens, frame, wavelengths_nm, times):
    """The capture's rows and columns, and the engine's plan."""
    grid = frame_capture(lens, frame, wavelengths_nm, options)
    return grid.shape_px, cached_plan(options, lens, Sampling(grid, wavelengths_nm), times)


plans = Answers(_plan, MOST_PLANS)
