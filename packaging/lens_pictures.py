"""The pictures by which the panel offers the bundled lenses: the sample scene through each of them.

    python packaging/lens_pictures.py [NAME ...]

makes engine/library/pictures/NAME.jpg for those named, or all; `make lens-pictures` does that with Blender's wheel.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import bpy
from PIL import Image

from lensfield import addon
from lensfield.engine.library import PICTURES, bundled_names
from lensfield.engine.spectral.wavelength_choice import SpectralOptions

SCENE = Path(__file__).resolve().parent.parent / "sample_scenes" / "evening_chess.blend"
RENDERED_PX, SHOWN_PX = (512, 384), (256, 192)
SAMPLES = 96
WAVELENGTHS_NM = range(400, 701, 25)


def main(names):
    addon.register()
    bpy.ops.wm.open_mainfile(filepath=str(SCENE))
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = RENDERED_PX
    scene.cycles.samples = SAMPLES
    for name in names or bundled_names():
        with TemporaryDirectory() as folder:
            result = addon.render_through_lens(scene, name, WAVELENGTHS_NM, folder, view="lens", denoise=True,
                                               spectral=SpectralOptions("preview"))
            picture = Image.open(result.after).convert("RGB").resize(SHOWN_PX, Image.Resampling.LANCZOS)
        picture.save(PICTURES / f"{name}.jpg", quality=88, optimize=True)
        print(name)
    addon.unregister()


if __name__ == "__main__":
    main(sys.argv[1:])
