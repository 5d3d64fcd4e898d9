"""The time that a scene's next render takes on this machine, learned from its last ones in this session."""

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path

from lensfield.engine.runtime.values import json_value

from ..job.result import Result
from ..scene.camera import frame_px
from .common.session import session

RENDER = "multispectral render"  # stage of a report; the others put its light through the lens


@dataclass(frozen=True)
class LearnedTime:
    """The time of a render.

    Attributes
    ----------
    kind : dict
        Settings that decide how many renders there are.
    samples : int
        Of all pixels of a render.
    render_s, lens_s : float
        Seconds of the renders, and of everything after them.
    planned_s : float
        Seconds of the lens by the engine's plan.
    """

    kind: dict
    samples: int
    render_s: float
    lens_s: float
    planned_s: float


def learn_time(scene_uid, lens_image):
    """Remember the time of a scene's finished frame, by the record next to its lens image."""
    try:
        facts = json.loads(Result.from_file(Path(lens_image), "lens_image").record.read_text(encoding="utf-8"))
        stages, job = facts["stages_s"], facts["job"]
        new = LearnedTime(_kind(job["spectral"], job["wavelengths_nm"], job["depth"]),
                          job["settings"]["samples"] * math.prod(facts["frame_px"]), stages[RENDER],
                          sum(stages.values()) - stages[RENDER], facts["plan"]["seconds"])
    except (OSError, ValueError, KeyError):  # of another lens on stored light, or of a traced lens
        return
    others = [each for each in session.times.get(scene_uid, ())
              if each.kind == new.kind and each.samples != new.samples]
    session.times[scene_uid] = *others[-1:], new


def expected_seconds(scene, request, planned_s):
    """Seconds of a scene's renders, and of the lens after them; None before the first render with these settings."""
    known = session.times.get(scene.session_uid, ())
    kind = _kind(json_value(asdict(request.spectral)), request.wavelengths_nm, request.depth)
    if not known or known[-1].kind != kind or not known[-1].planned_s:
        return None
    samples = scene.cycles.samples * math.prod(frame_px(scene))
    return _render_s(known, samples), known[-1].lens_s * planned_s / known[-1].planned_s


def _render_s(known, samples):
    """Seconds of renders with so many samples: in proportion to the last; after two that differ, with the time that
    renders take whatever their samples."""
    first, last = known[0], known[-1]
    if len(known) > 1:
        rate_s = (last.render_s - first.render_s) / (last.samples - first.samples)
        if rate_s > 0 and (fixed_s := last.render_s - rate_s * last.samples) > 0:
            return fixed_s + rate_s * samples
    return last.render_s * samples / last.samples


def _kind(spectral, wavelengths_nm, depth):
    return {"spectral": spectral, "wavelengths": len(wavelengths_nm), "depth": depth}
