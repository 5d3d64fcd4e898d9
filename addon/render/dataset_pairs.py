"""Pairs of pictures of a dataset, in the folders that public loaders read: with and without stray light, as the test
data of Flare7K++; or at small and wide stops, as RealBokeh.
"""

import json
import re

import numpy as np

from lensfield.engine.depth.depth_range import OFF
from lensfield.engine.pictures.preview import auto_exposure, to_rec709
from lensfield.engine.pictures.spectral_exr import read_exr, read_stray, write_rgb_exr
from lensfield.engine.plan.options import DEFAULT_ACCURACY
from lensfield.engine.runtime.build_identity import software
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.files import atomic_path, discard, matching
from lensfield.engine.stray.options import GHOSTS
from lensfield.engine.stray.stray_light import no_ghosts

from ...request import BOKEH, FLARE, IRRADIANCE
from ..job.shown import look_for, write_shown
from .comparison import rec709

FOLDER, LINEAR, SPLIT = "pairs", "linear", "train"
FLARE_FOLDERS = "input", "gt", "flare"  # flared, clean, and the stray light
SHARP, BLURRED, METADATA = "in", "gt", "metadata"


def check_pairs(kind, job, f_numbers):
    """Raise an InputError if the pictures of a job cannot have pairs of a kind, if any.

    Parameters
    ----------
    kind : str
        One of PAIRS, or "".
    job : Job
    f_numbers : sequence of float
        Of all pictures of its lens.
    """
    if kind == FLARE and not job.stray.parts(job.options.accuracy or DEFAULT_ACCURACY):
        raise InputError("options", "stray", job.stray.stray_light,
                         "pairs of flare need stray light: choose its parts, such as ghosts,veil,star")
    absent = no_ghosts(job.lens, np.array(job.wavelengths_nm)) if set(job.stray.listed) == {GHOSTS} else ""
    if kind == FLARE and absent:
        raise InputError("options", "stray", GHOSTS, f"{absent}; or add other parts, such as veil")
    if kind == FLARE and not job.writes(IRRADIANCE):
        raise InputError("options", "files", job.files, "pairs of flare are made from the irradiance: write it, too")
    if kind == BOKEH and len(f_numbers) < 2:
        raise InputError("options", "f-number", ",".join(map(str, f_numbers)), "pairs of bokeh need two or more")
    if kind == BOKEH and job.depth == OFF:
        raise InputError("options", "depth", OFF, "pairs of bokeh need blur by depth: expected auto")


def write_flare(result, folder, job):
    """Write a picture with and without stray light, and the stray light: as PNGs of the same exposure, and as linear
    Rec. 709 in single precision, whose sum is exact.

    Parameters
    ----------
    result : Result
        Names the irradiance file.
    folder : Path
        Of the dataset.
    job : Job

    Returns
    -------
    dict of str: Path
        The files.
    """
    name = f"{result.record.parent.name}_{result.stem}"
    flared, stray = to_rec709(read_exr(result.irradiance)), read_stray(result.irradiance)
    flare = np.zeros_like(flared) if stray is None else to_rec709(stray)
    exposure, look, paths = auto_exposure(flared), look_for(job), {}
    for kind, picture in zip(FLARE_FOLDERS, exact_sum(flared, flare), strict=True):
        paths[kind] = folder / FOLDER / kind / f"{name}.png"
        paths[f"{LINEAR}_{kind}"] = folder / FOLDER / LINEAR / kind / f"{name}.exr"
        write_shown(picture, paths[kind], exposure, look)
        write_rgb_exr(picture, paths[f"{LINEAR}_{kind}"])
    return paths


def exact_sum(flared, flare):
    """Float32 arrays flared, clean and flare, where clean + flare == flared in single precision; the first differs from
    the given one by rounding."""
    clean = flared - flare
    return clean + flare, clean, flare


def write_bokeh(lens, results, folder, job):
    """Write the pictures of a frame through a lens at several f-numbers as PNGs of the same exposure, and their
    metadata, in the place of those at other f-numbers.

    Parameters
    ----------
    lens : str
        Its name in file names.
    results : dict of float: Result
        By f-number, from the highest, which is the sharp picture.
    folder : Path
        Of the dataset.
    job : Job
        Of the sharp picture.

    Returns
    -------
    dict of str: Path
        The files.
    """
    split = folder / FOLDER / SPLIT
    sharp, *blurred = (rec709(result.lens_image) for result in results.values())
    source, *targets = (f"{kind}/{result.record.parent.name}_{result.stem}.png" for kind, result in zip(
        (SHARP, *[BLURRED] * len(blurred)), results.values(), strict=True))
    exposure, look = auto_exposure(sharp), look_for(job)
    for picture, path in zip((sharp, *blurred), (source, *targets), strict=True):
        write_shown(picture, split / path, exposure, look)
    source_av, *target_avs = results
    identity = f"{lens}_{next(iter(results.values())).stem}"
    metadata = split / METADATA / f"{identity}.json"
    values = {"software": software(), "id": identity, "source_image": source, "source_av": source_av,
              "target_images": targets, "target_avs": target_avs}
    with atomic_path(metadata) as temporary:
        temporary.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")
    of_frame = re.compile(rf"{re.escape(lens)}_f[^_]+_{re.escape(next(iter(results.values())).stem)}\.png")
    for path in matching(split, "*/*.png"):
        if of_frame.fullmatch(path.name) and path.relative_to(split).as_posix() not in (source, *targets):
            discard(path)
    return {"metadata": metadata, **{f"f{f_number:g}": split / path for f_number, path in zip(
        results, (source, *targets), strict=True)}}
