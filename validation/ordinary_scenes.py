"""Ordinary scenes, as artists make them, rendered by Lensfield through a nearly perfect lens and by Cycles alone.

    python validation/ordinary_scenes.py [NAME ...] [--output FOLDER] [--columns 96] [--samples 64] [--sample N]

Each scene is saved, opened, and rendered twice by Cycles with different seeds, whose difference is the noise; then by
Lensfield, once with everything sharp and once in layers of depth, which are compared with Cycles' own depth of field.
The means, blocks of 8 x 8 px, alpha and the places of marked objects must agree (`scene_measure.py`). FOLDER
(build/scenes by default) then contains the table, report.json, and for each scene its .blend and a picture: from the
left, plain and by Lensfield, sharp and then in layers. The exit status is 1 if a scene fails.

NAMEs select scenes or themes; --sample chooses N scenes by SEED. A process renders many scenes; if one of them crashes
it, another goes on with the next.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

SEED = int(os.environ.get("SEED", 0)) % 2**20
FOLDER = Path("build/scenes")
ERRORS = "errors.txt"
PASSED, FAILED, REFUSED, DIFFERENT, CRASHED = "passed", "FAILED", "refused", "differs", "CRASHED"
"""Results of a scene; it is "refused", or "differs" with a remark in Lensfield's report, only if that is expected."""
SHARP, LAYERS = "sharp", "layers"
OF_LAYERS = {"misplaced": 0.01, "detail": 0.35}
"""Limits of layers: the accuracy of depth in Standard, and the transition from in-focus to out-of-focus light, between
which a lamp of a pixel lies."""


@dataclass(frozen=True)
class Outcome:
    """The result of a scene.

    Attributes
    ----------
    name, theme, title, status : str
    words : str
        Why it failed or was refused.
    comparisons : dict
        The fields of `scene_measure.Comparison`, by "sharp" and "layers".
    remarks : list of str
        Of Lensfield's report.
    seconds : float
        Processor seconds.
    """

    name: str
    theme: str
    title: str
    status: str
    words: str = ""
    comparisons: dict = field(default_factory=dict)
    remarks: list = field(default_factory=list)
    seconds: float = 0.0

    @property
    def good(self):
        """Whether it is as expected."""
        return self.status in (PASSED, REFUSED, DIFFERENT)


def run(names, folder, columns, samples, seed=SEED):
    """Render scenes in processes of their own; yields their Outcome.

    Parameters
    ----------
    names : sequence of str
    folder : Path
        A folder for each scene is created in it.
    columns, samples, seed : int
    """
    left = list(names)
    for name in left:
        shutil.rmtree(folder / name, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    while left:
        with open(folder / ERRORS, "w") as errors, _child(left, folder, columns, samples, seed, errors) as child:
            for line in child.stdout:
                if line.startswith("{"):
                    yield Outcome(**json.loads(line))
                    left.pop(0)
        if left:
            yield _crashed(left.pop(0), child.returncode, folder)


def _child(names, folder, columns, samples, seed, errors):
    command = [sys.executable, "-W", "ignore", __file__, *names, "--output", folder, "--columns", columns, "--samples",
               samples, "--here"]
    return subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, stderr=errors, text=True,
                            env=os.environ | {"SEED": str(seed)})


def _crashed(name, status, folder):
    from scenes import ORDINARY

    scene = ORDINARY[name]
    ended = signal.Signals(-status).name if status < 0 else f"exit status {status}"
    lines = (folder / ERRORS).read_text(errors="replace").strip().splitlines()
    return Outcome(name, scene.theme, scene.title, CRASHED, f"{ended}: {lines[-1] if lines else ''}")


def run_here(names, folder, columns, samples):
    """Render scenes in this process, and print a line of JSON for each."""
    from scene_pictures import registered

    with registered():
        for name in names:
            outcome = outcome_of(name, folder / name, columns, samples)
            print(json.dumps(asdict(outcome)), flush=True)
    sys.stdout.flush()
    os._exit(0)  # some wheels crash while the interpreter exits


def outcome_of(name, folder, columns, samples):
    """The Outcome of a scene in this process."""
    from lensfield.engine.runtime.errors import InputError
    from scenes import ORDINARY

    scene, started = ORDINARY[name], time.process_time()
    path = saved(scene, folder, columns, samples)
    try:
        status, words, comparisons, remarks = _compared(scene, path, folder, samples)
    except InputError as error:
        as_expected = scene.refused and scene.refused in str(error)
        status, words, comparisons, remarks = REFUSED if as_expected else FAILED, str(error), {}, []
    return Outcome(name, scene.theme, scene.title, status, words, comparisons, remarks,
                   round(time.process_time() - started, 1))


def saved(scene, folder, columns, samples):
    """Make a scene of this width and save it; the path of the .blend."""
    import bpy

    from lensfield.commands.terminal import quiet
    from scenes.kit import set_stage

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{scene.name}.blend"
    scene.build(set_stage(folder, (columns * 2 // 3, columns), samples))
    with quiet(1):
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


def _compared(scene, path, folder, samples):
    """Status, words, comparisons and remarks of a scene."""
    from scene_measure import Marks
    from scene_pictures import lens_picture, marks_px

    if scene.refused:
        lens_picture(path, folder / SHARP, 1000 * SEED, 0.0, "off", **scene.request)
        return FAILED, f"not refused: expected {scene.refused!r}", {}, []
    marks, comparisons, remarks, shown = marks_px(path), {}, {}, []
    for depth in (SHARP, LAYERS) if scene.layers else (SHARP,):
        plain, without, picture = _pictures(scene, path, folder, depth)
        comparisons[depth] = _comparison(scene, plain, picture, Marks(marks, without, samples), depth)
        remarks |= dict.fromkeys(picture.report.remarks())
        shown += [plain[0], picture.picture]
    _show(shown, folder / "pictures.png")
    faults, unsaid = [*_faults(comparisons, marks)], [*_unsaid(scene, remarks)]
    comparisons = {depth: asdict(each) for depth, each in comparisons.items()}
    bad = DIFFERENT if scene.differs and not unsaid else FAILED
    return bad if faults or unsaid else PASSED, "; ".join(faults + unsaid), comparisons, [*remarks]


def _faults(comparisons, marks):
    """The faults of pictures: generator of text."""
    for depth, comparison in comparisons.items():
        yield from (f"{depth}: {fault}" for fault in comparison.faults)
        if marks and not comparison.off_px:
            yield f"{depth}: no mark is visible"


def _unsaid(scene, remarks):
    """What Lensfield's report does not state: generator of text."""
    for words in filter(None, (scene.remark, scene.differs)):
        if not any(words in remark for remark in remarks):
            yield f"no remark on {words!r}"


def _pictures(scene, path, folder, depth):
    """Two plain pictures of a scene, another without its marks, and its LensPicture."""
    from scene_pictures import WIDE_PX, PlainRender, lens_picture, plain_picture

    blur_px, first = (WIDE_PX, 3) if depth == LAYERS else (0.0, 0)
    changes = PlainRender(**scene.plain)
    plain = [plain_picture(path, folder, 1000 * SEED + first + number, blur_px, changes) for number in (0, 1)]
    without = plain_picture(path, folder, 1000 * SEED + first, blur_px, replace(changes, marks=False))
    picture = lens_picture(path, folder / depth, 1000 * SEED + first + 2, blur_px,
                           "auto" if depth == LAYERS else "off", changes.compositing, **scene.request)
    return plain, without, picture


def _comparison(scene, plain, picture, marks, depth):
    from scene_measure import Limits, compare

    facts = picture.report.scene
    colour_error = facts.estimated_colour_error + facts.rgb_difference + scene.colour
    limits = Limits(colour_error, scene.paint, **(OF_LAYERS if depth == LAYERS else {}))
    return compare(picture.picture, plain, marks, limits)


def _show(pictures, path):
    """Write pictures of a size next to each other, with the exposure of the first."""
    import numpy as np

    from lensfield.engine.pictures.preview import auto_exposure, write_png

    same = [np.nan_to_num(np.moveaxis(each[:3], 0, -1)) for each in pictures if each.shape == pictures[0].shape]
    write_png(np.concatenate(same, axis=1), path, auto_exposure(same[0]))


def table(outcomes):
    """The outcomes as lines of text."""
    columns = "".join(f" {head:<20} {'block':>6} {'marks':>6}" for head in ("R G B over plain", "in layers"))
    yield f"{'scene':<34} {'result':<8}{columns}"
    theme = None
    for outcome in outcomes:
        if outcome.theme != theme:
            theme = outcome.theme
            yield theme
        figures = " ".join(_figures(outcome, depth) for depth in (SHARP, LAYERS))
        yield f"  {outcome.name:<32} {outcome.status:<8} {figures}".rstrip()
        if outcome.words:
            yield f"      {outcome.words}"


def _figures(outcome, depth):
    """Ratios of means, the worst block's CIEDE2000 and the largest distance of a mark, in px."""
    found = outcome.comparisons.get(depth)
    if not found:
        return " " * 34
    off = max(found["off_px"].values(), default=0.0)
    return f"{' '.join(f'{ratio:6.4f}' for ratio in found['means'])} {found['worst_colour']:6.2f} {off:6.2f}"


def verdict(outcomes):
    """How many scenes passed and failed, in one line."""
    count = {status: sum(each.status == status for each in outcomes)
             for status in (PASSED, REFUSED, DIFFERENT, FAILED, CRASHED)}
    return (f"{count[PASSED]} passed, {count[FAILED] + count[CRASHED]} failed ({count[CRASHED]} crashed), "
            f"{count[REFUSED]} refused as expected, {count[DIFFERENT]} different as reported; SEED={SEED}")


def write_report(outcomes, folder):
    """Write the table and the figures to a folder."""
    (folder / "report.json").write_text(json.dumps([asdict(each) for each in outcomes], indent=1))
    (folder / "report.txt").write_text("\n".join([*table(outcomes), verdict(outcomes)]) + "\n")


def chosen(words, number=0, seed=SEED):
    """Names of the scenes that words select, as names or themes, or all; with a number, so many of them by a seed.

    Raises
    ------
    SystemExit
        A word selects none.
    """
    from scenes import ORDINARY

    names = [name for name, scene in ORDINARY.items() if not words or {name, scene.theme} & set(words)]
    if unknown := set(words) - set(names) - {scene.theme for scene in ORDINARY.values()}:
        raise SystemExit(f"{unknown.pop()}: not a scene; expected one of {', '.join(ORDINARY)}")
    return random.Random(seed).sample(names, min(number, len(names))) if number else names


def main(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--output", type=Path, default=FOLDER)
    parser.add_argument("--columns", type=int, default=96)
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--sample", type=int, default=0, metavar="N")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    names, folder = chosen(given.names, given.sample), given.output.resolve()
    if given.here:
        run_here(given.names, folder, given.columns, given.samples)
    outcomes = []
    for outcome in run(names, folder, given.columns, given.samples):
        outcomes.append(outcome)
        print(f"{len(outcomes)}/{len(names)} {outcome.name}: {outcome.status} {outcome.words}", flush=True)
    write_report(outcomes, folder)
    print(*table(outcomes), verdict(outcomes), sep="\n")
    return not all(outcome.good for outcome in outcomes)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
