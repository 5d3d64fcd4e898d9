"""The record of a frame: a JSON file next to its pictures, written after them.

It states the settings of the render and the size of each file. With it an animation resumes where it stopped, and
renders damaged or outdated frames again.
"""

import json
from dataclasses import asdict, is_dataclass

from ...engine.pictures.header_check import has_header
from ...engine.runtime.build_identity import software
from ...engine.runtime.files import atomic_path, file_status
from ...engine.runtime.setting import settings_of
from ...engine.runtime.values import json_value
from ..scene.camera import shift_px
from ..scene.units import metres_per_unit

IRRELEVANT = ("name", "device", "preview", "use_preview", "debug", "denoising_use_gpu", "use_auto_tile",
                 "tile_size", "bake_type")
"""Prefixes of Cycles settings that do not affect a final picture."""
OF_ACCOUNT = ("resolution_", "pixel_aspect_", "film_transparent", "use_border", "border_", "use_motion_blur",
              "motion_blur_", "use_simplify", "simplify_")
"""Prefixes of the scene's other render settings that do affect it."""


def picture_settings(scene):
    """The scene's render settings that affect a picture, its camera's Shift and subframe: a dict of JSON types."""
    cycles = {name: value for name, value in _values(scene.cycles) if not name.startswith(IRRELEVANT)}
    render = {name: value for name, value in _values(scene.render) if name.startswith(OF_ACCOUNT)}
    return json_value(cycles | render | {"metres_per_unit": metres_per_unit(scene), "shift_px": shift_px(scene),
                                         "subframe": scene.frame_subframe})


def write_record(job, result):
    """Write a frame's job, state and file sizes, with its report."""
    facts = {"software": software()} | result.report.as_dict() | {
        "job": recorded_fields(job), "state": job.state, "sizes": _sizes(result.pictures)}
    with atomic_path(result.record) as temporary:
        temporary.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")


def read_record(job, result):
    """The record of a frame if all its files exist, are complete, and come from this job; else None.

    Its "build" identifies the build that rendered the frame, which may differ from this one.
    """
    try:
        facts = json.loads(result.record.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    same = (isinstance(facts, dict) and isinstance(facts.get("build", ""), str)
            and facts.get("job") == recorded_fields(job) and isinstance(facts.get("state"), str)
            and facts.get("sizes") == _sizes(result.pictures)
            and all(has_header(path) for path in result.pictures if path.is_file()))
    return facts if same else None


def recorded_fields(job):
    """The fields of a job that affect its picture, in JSON types."""
    fields = {name: getattr(job, name) for name, each in settings_of(job).items() if each.recorded}
    values = {name: asdict(value) if is_dataclass(value) else value for name, value in fields.items()}
    return json_value(values | {"lens": job.lens.name, "lens_digest": job.lens.digest.hex(), "clamp": job.clamp,
                                "camera_digest": job.camera.digest.hex() if job.camera else "",
                                "settings": job.settings} | ({"shot": asdict(job.shot)} if job.shot else {}))


def _sizes(paths):
    return {path.name: (status := file_status(path)) and status.st_size for path in paths}


def _values(owner):
    """(name, value) of a data-block's settings, except read-only ones, pointers and collections."""
    for prop in owner.bl_rna.properties:
        if prop.type not in ("POINTER", "COLLECTION") and not prop.is_readonly:
            yield prop.identifier, getattr(owner, prop.identifier)
