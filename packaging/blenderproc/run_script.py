"""Run a script of BlenderProc in Blender's Python wheel, as Blender would.

    python run_script.py --background --python SCRIPT -- ARGUMENT ...

`packaging/blenderproc/blender` calls it. It changes nothing in BlenderProc 2.8.0, but prepares the wheel for it.
"""

import os
import runpy
import sys
import sysconfig
import traceback
from types import SimpleNamespace

import bpy


class Part:
    """Another object, with some attributes of its own."""

    def __init__(self, other, **attributes):
        vars(self).update(attributes, _other=other)

    def __getattr__(self, name):
        return getattr(self._other, name)


def main():
    script = sys.argv[sys.argv.index("--python") + 1]
    sys.path.append(sysconfig.get_path("purelib"))  # again, because BlenderProc removes the first one
    from blenderproc.python.utility import Initializer  # which also removes Blender's own arguments from sys.argv

    # It sets the language to English, but the wheel is built without languages.
    preferences = SimpleNamespace(view=SimpleNamespace(language="en_US"))
    Initializer.bpy = Part(bpy, context=Part(bpy.context, preferences=preferences))
    runpy.run_path(script, run_name="__main__")


if __name__ == "__main__":
    status = 0
    try:
        main()
    except Exception:
        traceback.print_exc()
        status = 2  # as --python-exit-code states
    sys.stdout.flush()
    os._exit(status)  # some of Blender's wheels crash while the interpreter exits
