"""What a frame's record states of its job: everything that the pictures depend on."""

from dataclasses import asdict, is_dataclass

from lensfield.engine.runtime.setting import settings_of
from lensfield.engine.runtime.values import json_value

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


def recorded_fields(job):
    """The fields of a job that affect its picture, in JSON types."""
    fields = {name: getattr(job, name) for name, each in settings_of(job).items() if each.recorded}
    values = {name: asdict(value) if is_dataclass(value) else value for name, value in fields.items()}
    return json_value(values | {"lens": job.lens.name, "lens_digest": job.lens.digest.hex(), "clamp": job.clamp,
                                "camera_digest": job.camera.digest.hex() if job.camera else "",
                                "settings": job.settings} | ({"shot": asdict(job.shot)} if job.shot else {}))


def _values(owner):
    """(name, value) of a data-block's settings, except read-only ones, pointers and collections."""
    for prop in owner.bl_rna.properties:
        if prop.type not in ("POINTER", "COLLECTION") and not prop.is_readonly:
            yield prop.identifier, getattr(owner, prop.identifier)
