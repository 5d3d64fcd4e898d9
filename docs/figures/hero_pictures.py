"""The pictures of the front page: one night portrait through ten lenses, in scope, and a focus pull.

    python docs/figures/hero_pictures.py FOLDER

writes docs/hero.jpg (three lenses side by side), docs/scope.jpg, docs/gallery/NAME.jpg and docs/focus_pull.webp; `make
hero` does that with Blender's wheel, in build/hero. Cycles renders `sample_scenes/night_portrait.blend` once, in layers
of depth; each lens, and each focus, is applied to these layers. The anamorphic lens sees more of the scene, and has a
render of its own. An existing capture and lens images in FOLDER are reused: delete the folder after you change the
scene.
"""

import sys
from pathlib import Path

import bpy
import numpy as np
from PIL import Image

from lensfield import addon
from lensfield.addon.scene.lens_facts import lens_facts
from lensfield.engine import Options
from lensfield.engine.spectral.wavelength_choice import SpectralOptions

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "sample_scenes" / "night_portrait.blend"
DOCS = ROOT / "docs"

SIDE_BY_SIDE = "kodak-petzval-100mm", "angenieux-50mm", "tessar-50mm"
GALLERY = ("tessar-50mm", "zeiss-biotar-50mm", "meyer-primoplan-75mm", "sonnar-50mm-f1.5", "kodak-petzval-100mm",
           "angenieux-50mm", "canon-50mm-f0.95", "mamiya-soft-focus-150mm", "canon-rf-85mm-f1.2",
           "nikkor-z-58mm-noct")
PULLED = "angenieux-50mm"
CAPTURE_LENS = "angenieux-50mm"
ANAMORPHIC, SCOPE_PX = "cooke-42mm-2x", (478, 400)
ROOM = 0.09  # of the frame's longer side, for the blur of f/0.95 at the edges
WAVELENGTHS_NM = range(430, 671, 40)
SAMPLES = 24

FRAME_PX, GALLERY_PX, PULL_PX, GAP_PX = (320, 400), (280, 350), (256, 320), 6
STILL, MOVING = Options(accuracy=0.01), Options(accuracy=0.05)  # more misplaced light shows as grain in the discs

FACE_M, FAR_M = 1.915, 40
PULL_STEPS, REST = 10, 8  # steps from one end to the other; duration of the ends, in frames
FRAME_MS = 90


def main(folder):
    addon.register()
    bpy.ops.wm.open_mainfile(filepath=str(SCENE))
    radiance = capture(bpy.context.scene, folder / "capture")
    side_by_side([portrait(name, radiance, folder) for name in SIDE_BY_SIDE]).save(DOCS / "hero.jpg", quality=90,
                                                                                optimize=True)
    (DOCS / "gallery").mkdir(exist_ok=True)
    for name in GALLERY:
        small = portrait(name, radiance, folder).resize(GALLERY_PX, Image.Resampling.LANCZOS)
        small.save(DOCS / "gallery" / f"{name}.jpg", quality=86, optimize=True)
    write_pull([developed(through(PULLED, radiance, folder / f"focus_{1000 * metres:.0f}mm", metres, MOVING))
                for metres in pull_m()], DOCS / "focus_pull.webp")
    scope(folder / "scope").save(DOCS / "scope.jpg", quality=90, optimize=True)
    addon.unregister()


def scope(output):
    """A film frame through the anamorphic lens, at its full width."""
    bpy.ops.wm.open_mainfile(filepath=str(SCENE))
    scene, squeeze = bpy.context.scene, lens_facts(ANAMORPHIC).squeeze
    lens_image = output / f"{Path(bpy.data.filepath).stem}_{scene.name}_{scene.frame_current:04d}_lens_image.exr"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.pixel_aspect_x = *SCOPE_PX, squeeze
    scene.cycles.samples = SAMPLES
    if not lens_image.exists():
        addon.render_through_lens(scene, lens=ANAMORPHIC, wavelengths_nm=WAVELENGTHS_NM, output_folder=output,
                                  view="camera", denoise="on", options=STILL, spectral=SpectralOptions("preview"),
                                  lens_quality="preview")
    picture = developed(lens_image)
    return picture.resize((round(squeeze * picture.width), picture.height), Image.Resampling.LANCZOS)


def capture(scene, output, size_px=FRAME_PX):
    """Capture the scene's light in layers of depth; returns the file."""
    radiance = output / f"{Path(bpy.data.filepath).stem}_{scene.name}_{scene.frame_current:04d}_radiance.exr"
    if not radiance.exists():
        scene.render.resolution_x, scene.render.resolution_y = size_px
        scene.cycles.samples = SAMPLES
        addon.render_through_lens(scene, lens=CAPTURE_LENS, wavelengths_nm=WAVELENGTHS_NM, output_folder=output,
                                  view="camera", denoise="on", room=ROOM, options=MOVING,
                                  spectral=SpectralOptions("preview"), lens_quality="preview")
    return radiance


def portrait(lens, radiance, folder):
    return developed(through(lens, radiance, folder / lens, FACE_M, STILL))


def through(lens, radiance, output, focus_m, options):
    """Apply a lens focused at a distance; returns the file of the lens image."""
    lens_image = output / radiance.name.replace("radiance", "lens_image")
    if not lens_image.exists():
        print(output.name, flush=True)
        addon.apply_lens(radiance, lens=lens, output_folder=output, view="camera", options=options,
                         focus=1000 * focus_m, lens_quality="preview")
    return lens_image


def developed(exr):
    """An EXR after the scene's view transform, as Blender displays it."""
    scene = bpy.context.scene
    png, picture = exr.with_suffix(".png"), bpy.data.images.load(str(exr))
    scene.render.image_settings.file_format = "PNG"
    picture.save_render(str(png), scene=scene)
    bpy.data.images.remove(picture)
    with Image.open(png) as written:
        return written.convert("RGB")


def side_by_side(pictures):
    width, height = pictures[0].size
    sheet = Image.new("RGB", (len(pictures) * (width + GAP_PX) - GAP_PX, height), "white")
    for index, picture in enumerate(pictures):
        sheet.paste(picture, (index * (width + GAP_PX), 0))
    return sheet


def pull_m():
    """Focus distances from the face to the far lamps; 1 / distance eases in and out."""
    t = np.arange(PULL_STEPS + 1) / PULL_STEPS
    return 1 / (1 / FACE_M + t * t * (3 - 2 * t) * (1 / FAR_M - 1 / FACE_M))


def write_pull(frames, path):
    """Write the pull in both directions, with a rest at each end."""
    order = [*range(len(frames)), *range(len(frames) - 2, 0, -1)]
    times_ms = [FRAME_MS * (REST if index in (0, len(frames) - 1) else 1) for index in order]
    first, *others = [frames[index].resize(PULL_PX, Image.Resampling.LANCZOS) for index in order]
    first.save(path, save_all=True, append_images=others, duration=times_ms, loop=0, quality=72, method=6)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
