"""Read every lens file in some folders with the readers of prescriptions, and report notes and reasons for rejection.

    python validation/lens_files.py FOLDER [FOLDER ...] [--list]

Prints a table of formats and a table of reasons for rejection; --list names every file. A file must be rejected if its
stated focal length, which is parsed here independently of the readers, differs by more than 1 % from that of its
surfaces. The exit status is 1 if such a file is accepted, or if a reader fails with an error other than a `LensError`.
A thousand files take about half a minute.
"""

import argparse
import json
import re
import sys
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lensfield.engine import LensError
from lensfield.engine.prescription.readers import SUFFIXES, ReadingOptions, read_prescription
from lensfield.engine.prescription.system import system_of

FIELD = "image_height_mm", 10.0  # for files that do not state the end of the field; it does not affect paraxial figures
TOLERANCE = 0.01
NUMBER = r"([-+]?\d[\d.]*(?:[eE][-+]?\d+)?)"
STATED = {kind: re.compile(pattern, re.MULTILINE) for kind, pattern in (
    (".lens", rf"^focal_length:\s*{NUMBER}"), (".txt", rf"^Focal Length\t{NUMBER}"),
    (".dat", rf"\A(?:\s*#.*\n|\s*\n)*\s*{NUMBER}\s*$"), (".toml", rf"^focal_length_mm\s*=\s*{NUMBER}"),
    ("DeepLens", rf'"foclen":\s*{NUMBER}'), ("lentil", rf'"focal-length-mm-patent":\s*{NUMBER}'),
    ("Ghostlight", rf'"focal_length_mm":\s*{NUMBER}'), ("physical-camera", rf"^focal_length\s*=\s*{NUMBER}"))}
PROGRAMS = {".json": {"lentil": "optical-elements-patent", "Optiland": "surface_group", "DeepLens": '"surfaces"'},
            ".lens": {"Ghostlight": "ghostlight-optical"}, ".toml": {"physical-camera": "[[surface]]"}}
"""Programs that share a suffix, and a part of their files."""
READ, NOTED, UNKNOWN, REJECTED = "read", "read with notes", "unknown glass", "rejected"
WRONG, FAILED = "wrong without a note", "failed"
OUTCOMES = (READ, NOTED, UNKNOWN, REJECTED, WRONG, FAILED)


class Outcome(NamedTuple):
    """The result for a lens: its file, the format, one of `OUTCOMES`, and the reason or the notes."""

    path: Path
    kind: str
    outcome: str
    words: str


def outcomes(path):
    """The Outcome of each lens in a file."""
    text = path.read_bytes().replace(b"\0", b"").decode("utf-8", "replace")
    kind = _kind(path, text)
    if kind != "lentil":
        return [_outcome(path, kind, text, None)]
    return [_outcome(path, kind, json.dumps(entry), which) for which, entry in json.loads(text).items()]


def _kind(path, text):
    """The program, if several share the suffix, or the suffix."""
    suffix = path.suffix.lower()
    return next((name for name, sign in PROGRAMS.get(suffix, {}).items() if sign in text), suffix)


def _outcome(path, kind, text, which):
    try:
        lens = read_prescription(path, ReadingOptions(FIELD, which))
    except LensError as error:
        return Outcome(path, kind, REJECTED, _reason(error))
    except Exception as error:  # of any kind: finding these is the purpose of this program
        return Outcome(path, kind, FAILED, f"{type(error).__name__}: {error}")
    try:
        traced_mm = _focal_length_mm(lens)
    except LensError as error:  # a bake fails with it, unless --glass names another
        return Outcome(path, kind, UNKNOWN if error.field.endswith("glass") else REJECTED, _reason(error))
    stated = STATED.get(kind) and STATED[kind].search(text)
    if stated and not abs(traced_mm / float(stated[1]) - 1) <= TOLERANCE:
        return Outcome(path, kind, WRONG, f"states {stated[1]} mm, traced {traced_mm:.4g} mm")
    return Outcome(path, kind, NOTED if lens.notes else READ, lens.notes)


def _focal_length_mm(lens):
    """The focal length of the surfaces; a glass that is given only by its index gets an arbitrary Abbe number."""
    bare = {surface.glass: f"{surface.glass}/50" for surface in lens.surfaces if re.fullmatch(r"[\d.]+", surface.glass)}
    with np.errstate(all="ignore"):
        return float(system_of(lens.with_glasses(bare)).efl_mm)


def _reason(error):
    """An error without the parts that differ between files."""
    field = re.sub(r"\d+", "N", error.field)
    if field in ("focal length", "f-number") and "its s" in str(error.value):
        return f"states another {field} than its surfaces give"
    value = error.value if field.endswith(("surface N", "aperture", "DOE")) else ""
    remedy = re.sub(r"[-\d.]*\d", "N", error.remedy)
    return f"{field}{' is ' * bool(value)}{value}: {re.split('[;:]', remedy)[0][:90]}"


def table(results):
    """Rows of a table: a format, and the number of lenses with each outcome."""
    counts = Counter((result.kind, result.outcome) for result in results)
    yield f"{'format':<16}" + "".join(f"{name:>22}" for name in OUTCOMES) + f"{'all':>8}"
    for kind in [*sorted({result.kind for result in results}), "all"]:
        row = [sum(count for (of, outcome), count in counts.items() if outcome == name and kind in (of, "all"))
               for name in OUTCOMES]
        yield f"{kind:<16}" + "".join(f"{count:>22}" for count in row) + f"{sum(row):>8}"


def main(arguments=None):
    """Print the tables, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    parser.add_argument("--list", action="store_true", help="name every file, with its outcome")
    options = parser.parse_args(arguments)
    paths = sorted(path for folder in options.folders for path in folder.rglob("*")
                   if path.suffix.lower() in SUFFIXES and path.is_file())
    results = [result for path in paths for result in outcomes(path)]
    print(*table(results), sep="\n")
    for kind, reason, count in _reasons(results):
        print(f"{count:>6}  {kind:<15} {reason}")
    shown = OUTCOMES if options.list else (WRONG, FAILED)
    for result in results:
        if result.outcome in shown:
            print(f"{result.path}: {result.outcome}: {result.words}")
    return int(any(result.outcome in (WRONG, FAILED) for result in results))


def _reasons(results):
    """(format, reason, count) of rejections, the most frequent first."""
    counts = Counter((result.kind, result.words) for result in results if result.outcome == REJECTED)
    return [(*key, count) for key, count in counts.most_common()]


if __name__ == "__main__":
    sys.exit(main())
