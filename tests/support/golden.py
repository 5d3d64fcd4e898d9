"""What old files of Lensfield contain, as today's code reads them: numbers and texts by name."""

from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np

from lensfield import load_camera, read_film
from lensfield.engine.lens_files.export import read_export
from lensfield.engine.lens_files.package import read_package
from lensfield.engine.pictures.frame_record import read_record
from lensfield.engine.pictures.spectral_exr import read_attribute, read_sources, read_stray, read_with_layers
from lensfield.engine.prescription.readers import read_prescription
from places import DATA

FACTS = "facts.json"
FOLDERS = sorted(DATA.glob("golden-*"))
RECORDED_JOB = {"lens": "hand-made", "wavelengths_nm": [500.0, 600.0], "options": {"accuracy": 0.01}}
OF_IMAGE = ("quantity", "arbitrary", "wavelengths_nm", "cube", "pitch_um", "centre_px", "overscan_px", "squeeze",
            "projection", "focal_mm", "exposure", "lens_name", "f_number_effective", "detail")


def facts_of(path):
    """The facts in a file: dict of numbers and texts."""
    return dict(_flat(READERS[path.name](path)))


def _exr(path):
    image, planes, layered = read_with_layers(path)
    return {"image": {name: getattr(image, name) for name in OF_IMAGE},
            "planes": {name: planes[name] for name in ("A", "Z") if name in planes},
            "layers": list(layered.layers) if layered else [], "sources": read_sources(path),
            "stray": getattr(read_stray(path), "cube", None),
            "attribute": read_attribute(path, "lensfield:origin")}


def _record(path):
    record = read_record(path, RECORDED_JOB, [])
    return {name: record[name] for name in ("build", "job", "sizes", "state")}


READERS = {"lens.npz": read_package, "grid_lens.npz": read_package, "prescription.toml": read_prescription,
           "lens.toml": read_export, "camera.toml": load_camera, "film.toml": read_film, "radiance.exr": _exr,
           "panorama.exr": _exr, "irradiance.exr": _exr, "shot_Scene_0001_report.json": _record}
"""Readers by the name of a file in a golden folder. Files of Blender are read in tests/addon/test_golden_blend.py."""


def _flat(value, name=""):
    """(name, number or text) of everything in a value. Of an array, its shape, its sum, and a sum with weights that
    increase from 1 to 2, which depends on the order."""
    if is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(inner, f"{name}.{key}".lstrip("."))
    elif isinstance(value, np.ndarray):
        numbers = np.nan_to_num(value.astype(float), posinf=1e10).ravel()
        yield name, [*value.shape, float(numbers.sum()), float(numbers @ np.linspace(1, 2, numbers.size))]
    elif isinstance(value, list | tuple):
        yield f"{name}.count", len(value)
        for index, inner in enumerate(value):
            yield from _flat(inner, f"{name}.{index}")
    elif isinstance(value, Path):
        yield name, value.name
    elif isinstance(value, int | float | str | np.number | None):
        yield name, str(value) if isinstance(value, float) and not np.isfinite(value) else value
    else:
        raise TypeError(f"{name} is a {type(value).__name__}")
