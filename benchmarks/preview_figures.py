"""What the preview of the sample scene takes: from nothing, through other lenses, as rings are turned, and after a
change. Seconds on the clock, and of the processor; on a machine that does nothing else the first count.

    python benchmarks/preview_figures.py
"""

import resource
import time
from pathlib import Path

import bpy

from lensfield import addon
from lensfield.addon.ui import preview

SCENE = Path(__file__).parents[1] / "sample_scenes" / "evening_chess.blend"
LENSES = "tessar-50mm", "nikkor-28mm", "apple-phone-4mm", "angenieux-50mm", "muller-fisheye-25mm", "edmund-54852"
POLL_S = 0.01


def shown(what):
    """Tick until all is shown, and print what that took."""
    begin = time.monotonic()
    while preview.tick() is not None and (preview.state["preview"].asked or not preview.state["preview"].fresh):
        time.sleep(POLL_S)
    now = preview.state["preview"]
    print(f"{what:<40}{time.monotonic() - begin:8.2f} s  {now.error}", flush=True)


def turn_rings(dof):
    """Of the last lens and of a fast one: each ring, once to where it has not been before."""
    dof.use_dof = True
    for lens in LENSES[-1], "canon-50mm-f0.95":
        bpy.context.scene.lensfield.lens = lens
        for name, value in (("aperture_fstop", 4.0), ("aperture_fstop", 8.0), ("focus_distance", 1.1)):
            setattr(dof, name, value)
            bpy.context.view_layer.update()
            shown(f"{lens}, {name} {value:g}")


def main():
    addon.register()
    bpy.ops.wm.open_mainfile(filepath=str(SCENE))
    scene = bpy.context.scene
    scene.lensfield.view = "CAMERA"
    begin = time.monotonic()
    preview.start(scene)
    shown("from nothing")
    for lens in LENSES:
        scene.lensfield.lens = lens
        bpy.context.view_layer.update()
        shown(lens)
    turn_rings(scene.camera.data.dof)
    bpy.data.lights[0].energy *= 1.1
    bpy.context.view_layer.update()
    shown(f"after a change, {preview.STILL_S} s of stillness included")
    print(f"copies of the file                      {preview.state['preview'].copies_s[-1]:8.2f} s")
    seconds = time.monotonic() - begin
    preview.end()
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(f"in all {seconds:.1f} s; of the child's processor time {used.ru_utime + used.ru_stime:.1f} s")


if __name__ == "__main__":
    main()
