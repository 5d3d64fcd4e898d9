"""The index of a dataset: a line of JSON for each finished picture, and the calibrations of its cameras.

Each picture has its line in a file of its own. The index joins these files, so it depends on the existing pictures
alone, whichever processes rendered them.
"""

import json
import time
from itertools import groupby
from pathlib import Path

import numpy as np

from lensfield.engine.calibration.formats import FORMATS, OPTION, calibrated_for
from lensfield.engine.calibration.models import MODELS
from lensfield.engine.calibration.stored import calibration_from, calibration_values
from lensfield.engine.calibration.views import View
from lensfield.engine.inspection.curves import reference_nm
from lensfield.engine.pictures.frame_record import RECORD_END
from lensfield.engine.pictures.spectral_exr import read_parts
from lensfield.engine.runtime.build_identity import software
from lensfield.engine.runtime.errors import InputError
from lensfield.engine.runtime.files import atomic_path, discard, matching
from lensfield.engine.runtime.locks import Busy, only_writer
from lensfield.engine.runtime.values import json_value

FORMAT, VERSION = "lensfield-dataset", 1
INDEX, LINE_END = "index.jsonl", "picture.json"
WAIT_S = 0.1  # until another process has written the index


def calibrations(camera, formats, models):
    """The calibrations of a FrameCamera, and the contents of their files with this camera alone: dict of str:
    Calibration, and dict of str: str, by format.

    Parameters
    ----------
    camera : FrameCamera
    formats : iterable of str
    models : dict of str: str or None
        Names of models by format; without one, the simplest that fits.

    Raises
    ------
    InputError
        A format cannot describe the lens or the camera.
    """
    try:
        fits = {name: calibrated_for(name, camera.lens, camera.grid, reference_nm(camera.lens), models.get(name))
                for name in formats}
        return fits, {name: FORMATS[name].text([View(fit, camera.pose, camera.picture)]) for name, fit in fits.items()}
    except InputError as error:
        if error.field != OPTION:
            raise
        raise InputError("options", "calibration", error.value, error.remedy) from None


def fisheye_models(camera, formats):
    """The fisheye models that fit a FrameCamera, by format: dict of str: name, or None for an ordinary camera."""
    return {name: _fisheye([fit.model]) for name, fit in calibrations(camera, formats, {})[0].items()}


def shared_models(models, kept):
    """The models for formats whose file has the cameras of several frames, and states once whether they are fisheyes:
    dict of str: name, or None for the simplest.

    Parameters
    ----------
    models : dict of str: str or None
        By format: of the fisheyes among the cameras; None without any.
    kept : list of dict
        Lines of a scene's other pictures in the same folder.

    Raises
    ------
    InputError
        A camera is a fisheye, but other pictures already have ordinary ones.
    """
    shared = {}
    for name, fisheye in models.items():
        written = {line["frame"]: MODELS[line["calibration"][name]["model"]]
                   for line in kept if name in line["calibration"]}
        ordinary = [frame for frame, model in written.items() if not model.fisheye]
        if fisheye and ordinary:
            raise InputError("options", "calibration", name, "some of the frames are fisheyes, unlike frame "
                             f"{ordinary[0]}, which is in the file already: render all of them together (--frames), if "
                             "need be with --overwrite, or into another folder")
        shared[name] = fisheye or _fisheye(written.values())
    return shared


def _fisheye(models):
    """The name of the first model of a fisheye; None without one."""
    return next((model.name for model in models if model.fisheye), None)


def kept_lines(folder, stem, frames):
    """The lines of a scene's finished pictures in a folder, without the given frames: list of dict."""
    lines = filter(None, (_finished(folder.parent, path) for path in matching(folder, f"{stem}_*_{LINE_END}")))
    return [line for line in lines if _scene_of(line) == f"{folder.name}/{stem}" and line["frame"] not in frames]


def write_line(result, camera, facts, formats, pairs, models):
    """Write the line of a finished picture, and the calibration files that are for one camera. Calibrations for other
    formats and pairs of other kinds in an existing line remain.

    Parameters
    ----------
    result : Result
        Names the files; their folder is in the dataset's folder.
    camera : FrameCamera
    facts : dict
        Of the line.
    formats : sequence of str
        Of calibrations.
    pairs : dict of str: dict of str: Path
        Files of pairs by kind and name.
    models : dict of str: str or None
        Of calibrations, as for `calibrations`.
    """
    folder = result.record.parents[1]
    earlier = _line(line_path(result)) or {"calibration": {}, "pairs": {}}
    files, (fits, texts) = _files(result), calibrations(camera, formats, models)
    files |= {name: folder / earlier["files"][name] for name in earlier["calibration"]}
    for name, text in texts.items():
        files[name] = _calibration_path(result, name)
        if not FORMATS[name].poses:
            _write(files[name], text)
    line = {"software": software(), "format": FORMAT, "version": VERSION, **facts, "frame": result.frame,
            "files": _relative(files, folder),
            "pairs": earlier["pairs"] | {kind: _relative(paths, folder) for kind, paths in pairs.items()},
            "truth_channels": _channels(result.truth) if "truth" in files else [],
            "size_px": camera.grid.shape_px[::-1], "pose": camera.pose,
            "calibration": earlier["calibration"] | {name: calibration_values(fit) for name, fit in fits.items()}}
    _write(line_path(result), _text(line))


def _relative(paths, folder):
    return {name: path.relative_to(folder).as_posix() for name, path in paths.items()}


def _files(result):
    """The existing files of a Result by kind: dict of str: Path."""
    return {name: path for name, path in vars(result).items() if isinstance(path, Path) and path.is_file()}


def line_path(result):
    """The file with the line of a picture."""
    return result.record.with_name(f"{result.stem}_{LINE_END}")


def _calibration_path(result, name):
    """The file with a picture's camera for a program: of the picture, or of all pictures of the scene through a lens if
    the file states their places."""
    stem = result.stem.rpartition("_")[0] if FORMATS[name].poses else result.stem
    return result.record.with_name(f"{stem}_{name}{FORMATS[name].suffix}")


def forget_line(result):
    """Remove the line of a picture that is about to be rendered."""
    discard(line_path(result))


def forget_pairs(kind, lens, results):
    """Remove the pairs of a kind from the lines of a frame's other pictures through a lens, whose pairs are replaced.

    Parameters
    ----------
    kind : str
    lens : str
        As in the lines.
    results : iterable of Result
        The pictures of the new pairs.
    """
    paths = list(map(line_path, results))
    for path in set(matching(paths[0].parents[1], f"*/{paths[0].name}")) - set(paths):
        line = _line(path)
        if line and line.get("lens") == lens and line["pairs"].pop(kind, None):
            _write(path, _text(line))


def has_line(result, formats, pairs, models):
    """Whether a picture has its line, with calibrations for these formats, by these models for those that have one, and
    with pairs of a kind, if any."""
    line = _line(line_path(result))
    return (line is not None and line["calibration"].keys() >= set(formats) and (not pairs or pairs in line["pairs"])
            and all(model in (None, line["calibration"][name]["model"]) for name, model in models.items()))


def write_index(folder):
    """Write the index of a dataset's folder, and the calibration files of cameras with places: one for each scene in a
    picture's folder.

    Waits for other processes that write them.
    """
    while True:
        try:
            with only_writer(folder / INDEX):
                return _write_index(folder)
        except Busy:
            time.sleep(WAIT_S)


def _write_index(folder):
    lines = sorted(filter(None, (_finished(folder, path) for path in matching(folder, f"*/*_{LINE_END}"))),
                   key=lambda line: (_scene_of(line), line["frame"]))
    _write(folder / INDEX, "".join(map(_text, lines)))
    for name in (name for name, each in FORMATS.items() if each.poses):
        able = [line for line in lines if name in line["calibration"]]
        for file, of_scene in groupby(able, key=lambda line: line["files"][name]):
            _write(folder / file, FORMATS[name].text([_view(line, name) for line in of_scene]))


def _finished(folder, path):
    """The contents of a line if its picture is finished: it has a record, which a render removes first; else None."""
    line = _line(path)
    return line if line and (folder / line["files"]["record"]).is_file() else None


def _line(path):
    """The contents of a line; None if it is missing, damaged or of another version."""
    try:
        line = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return line if _is_whole(line) else None


def _is_whole(line):
    """Whether a line of this version has what the index and the calibration files are made of."""
    try:
        views = [_view(line, name) for name in line["calibration"]]
        return (line["version"] == VERSION and isinstance(line["frame"], int) and isinstance(line["pairs"], dict)
                and all(isinstance(file, str) for file in line["files"].values())
                and line["files"].keys() >= {"record", *line["calibration"]}
                and all(view.pose.shape == (4, 4) for view in views))
    except (AttributeError, KeyError, TypeError, ValueError):
        return False


def _view(line, name):
    return View(calibration_from(line["calibration"][name]), np.array(line["pose"]), Path(line["files"]["after"]).name)


def _channels(path):
    """The channels of an EXR."""
    return sorted(read_parts(path, header_only=True)[0][0]["channel names"])


def _scene_of(line):
    """The start of the names of a scene's files through a lens, and their folder."""
    return line["files"]["record"].removesuffix(f"_{RECORD_END}").rpartition("_")[0]


def _text(line):
    return json.dumps(json_value(line), ensure_ascii=False) + "\n"


def _write(path, text):
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
