"""The thumbnails of lenses: the sample scene, scaled to each lens's sensor, and its edge enlarged.

    python packaging/lens_pictures.py [NAME ...]

writes engine/library/pictures/NAME.jpg for these or all lenses; `make lens-pictures` does that with Blender's wheel.
The scene is rendered once, and the distortion, vignetting and blur of each lens, wide open, are applied to it. Only a
lens that is too wide for that picture requires a separate render.
"""

import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import bpy
from PIL import Image

from lensfield import addon
from lensfield.engine import Options, simulate
from lensfield.engine.field.field_map import field_map
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.lens.pinhole import fitting_pitch_um
from lensfield.engine.library import PICTURES, bundled_names, load_lens
from lensfield.engine.pictures.preview import auto_exposure, to_rec709, write_png
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.wavelength_choice import SpectralOptions

SCENE = Path(__file__).resolve().parent.parent / "sample_scenes" / "evening_chess.blend"
RENDERED_PX, SHOWN_PX = (1024, 768), (256, 192)
VIEW_LENS = "edmund-54852"  # the scene is rendered with its view
ROOM = 0.2  # overscan for barrel distortion
SAMPLES = 48
WAVELENGTHS_NM = range(400, 701, 25)
ENLARGED_BOX = (0, 76, 128, 172)  # of the rendered picture: lamps by its left edge


def main(names):
    addon.register()
    bpy.ops.wm.open_mainfile(filepath=str(SCENE))
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = RENDERED_PX
    scene.cycles.samples = SAMPLES
    with TemporaryDirectory() as folder:
        stored = None
        for name in names or bundled_names():
            lens, picture = load_lens(name, quality="preview"), Path(folder) / f"{name}.png"
            if is_too_wide(lens):
                rgb = to_rec709(read_exr(render(scene, name, folder).irradiance))
            else:
                stored = stored or read_exr(render(scene, VIEW_LENS, folder).radiance)
                grid = replace(stored.grid, pitch_um=fitting_pitch_um(lens, stored.frame_px))
                rgb = to_rec709(simulate(replace(stored, grid=grid), lens, Options(accuracy=0.03)))
            write_png(rgb, picture, auto_exposure(rgb))
            shown(Image.open(picture).convert("RGB")).save(PICTURES / f"{name}.jpg", quality=85, optimize=True)
            print(name, flush=True)
    addon.unregister()


def render(scene, name, folder):
    """The scene through a lens, in its own view."""
    return addon.render_through_lens(scene, lens=name, wavelengths_nm=WAVELENGTHS_NM, output_folder=Path(folder) / name,
                                     view="lens", denoise="on", room=ROOM, spectral=SpectralOptions("preview"),
                                     lens_quality="preview")


def is_too_wide(lens):
    """Whether a lens needs more than the stored picture's overscan."""
    frame = RENDERED_PX[::-1]
    grid = PixelGrid(frame, fitting_pitch_um(lens, frame))
    return max(field_map(lens).overscan_px(grid, WAVELENGTHS_NM, 0)) > ROOM * max(frame)


def shown(picture):
    """The picture reduced in size, with lamps near its edge enlarged in the opposite corner."""
    small = picture.resize(SHOWN_PX, Image.Resampling.LANCZOS)
    enlarged = picture.crop(ENLARGED_BOX).resize([side * 5 // 12 for side in SHOWN_PX], Image.Resampling.BICUBIC)
    frame = Image.new("RGB", [side + 2 for side in enlarged.size], "white")
    frame.paste(enlarged, (1, 1))
    small.paste(frame, [outer - inner for outer, inner in zip(small.size, frame.size, strict=True)])
    return small


if __name__ == "__main__":
    main(sys.argv[1:])
