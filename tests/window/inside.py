"""Run one step of `steps.py` in this Blender: `blender … --python inside.py -- STEP ZIP FOLDER`."""

import sys
import traceback
from pathlib import Path

import bpy

sys.path[:0] = [str(Path(__file__).resolve().parent), str(Path(__file__).resolve().parents[1] / "support")]
import hands  # noqa: E402
import steps  # noqa: E402

FIRST_S = 1.5  # for Blender to draw its window


def take(step):
    """Continue a step; at its end, quit Blender. The step returns the items that must disappear afterwards."""
    wrong, gone = "", ()
    try:
        return next(step)
    except StopIteration as end:
        gone = end.value or ()
    except Exception as error:
        traceback.print_exc()
        line = traceback.extract_tb(error.__traceback__)[-1]
        wrong = f"{Path(line.filename).name}:{line.lineno}: {line.line if isinstance(error, AssertionError) else error}"
    hands.shoot("failed" if wrong else "end")
    hands.report(wrong, gone=gone)
    bpy.ops.wm.quit_blender()
    return None


def main():
    step = getattr(steps, hands.STEP)()
    view = bpy.context.preferences.view
    view.show_splash, view.render_display_type = False, "WINDOW"  # the step before may have saved another type on exit
    bpy.app.timers.register(lambda: take(step), first_interval=FIRST_S, persistent=True)


main()
