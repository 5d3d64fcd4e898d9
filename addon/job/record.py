"""The record of a frame: a JSON file beside its pictures, written after them. It tells of what they were made and how
large each file is, so that an animation goes on where it was left, and makes again what is damaged or out of date."""

import json
from dataclasses import asdict

from ...engine.files import MARK, atomic_path
from ...engine.image.whole import has_header
from ...engine.values import plain

OF_NO_ACCOUNT = ("name", "device", "preview", "use_preview", "debug", "denoising_use_gpu", "use_auto_tile",
                 "tile_size", "bake_type")
"""How Cycles' settings begin that change no final picture."""
OF_ACCOUNT = ("resolution_", "pixel_aspect_", "film_transparent", "use_border", "border_", "use_motion_blur",
              "motion_blur_", "use_simplify", "simplify_")
"""How those of the scene's other render settings begin that do."""
NOT_ASKED = ("output_folder", "frame", "to_compositor", "lens_warning", "ring_words", "picture", "state", "source",
             "others")
"""What a job says that is not of the picture itself."""


def picture_settings(scene):
    """What of the scene's render settings counts for a picture: a dict as JSON holds it."""
    cycles = {name: value for name, value in _values(scene.cycles) if not name.startswith(OF_NO_ACCOUNT)}
    return plain(cycles | {name: value for name, value in _values(scene.render) if name.startswith(OF_ACCOUNT)})


def write_record(job, result):
    """Write what a frame's pictures were made by, and its report."""
    facts = {"software": MARK} | result.report.as_dict() | {
        "job": asked_of(job), "state": job.state, "sizes": _sizes(result.pictures)}
    with atomic_path(result.record) as temporary:
        temporary.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")


def read_record(job, result):
    """The record of a frame, if all its files are there, whole, and made by this job; else None."""
    try:
        facts = json.loads(result.record.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    same = (isinstance(facts, dict) and facts.get("job") == asked_of(job) and isinstance(facts.get("state"), str)
            and facts.get("sizes") == _sizes(result.pictures)
            and all(has_header(path) for path in result.pictures if path.is_file()))
    return facts if same else None


def asked_of(job):
    """What a job asks of its picture, as JSON holds it."""
    asked = {name: value for name, value in vars(job).items() if name not in NOT_ASKED}
    return plain(asked | {"lens": job.lens.name, "lens_digest": job.lens.digest.hex(), "options": asdict(job.options),
                          "spectral": asdict(job.spectral), "iris": job.iris and asdict(job.iris)})


def _sizes(paths):
    return {path.name: path.stat().st_size if path.is_file() else None for path in paths}


def _values(owner):
    """The settings of a data-block that hold one value, by name."""
    for prop in owner.bl_rna.properties:
        if prop.type not in ("POINTER", "COLLECTION") and not prop.is_readonly:
            yield prop.identifier, getattr(owner, prop.identifier)
