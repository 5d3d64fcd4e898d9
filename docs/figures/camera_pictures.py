"""The pictures of docs/camera.md: sample scenes through lenses and cameras, developed from their raw files.

    python docs/figures/camera_pictures.py FOLDER

writes docs/camera_NAME.jpg, and the raw files to FOLDER; `make camera-pictures` does that in build/camera. LibRaw
develops them with its own demosaicing and colours, as other raw converters would. Existing raw files are reused: delete
the folder after you change a scene.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import bpy
import rawpy
from PIL import Image

from lensfield import addon
from lensfield.engine.spectral.wavelength_choice import SpectralOptions

ROOT = Path(__file__).resolve().parents[2]
WAVELENGTHS_NM = range(400, 701, 20)
SHOWN_PX = 600  # the longer side


@dataclass(frozen=True)
class Shot:
    """A sample scene, its size in pixels, and the lens and the camera that take it."""

    scene: str
    size_px: tuple[int, int]
    lens: str
    camera: str
    iso: float
    focus_mm: float | None = None
    samples: int = 48


SHOTS = {"phone": Shot("evening_chess", (640, 480), "apple-phone-4mm", "generic-phone", 200.0, 270.0),
         "petzval": Shot("night_portrait", (400, 600), "kodak-petzval-100mm", "sony-a7-iv", 1600.0, 1915.0)}


def main(folder):
    addon.register()
    for name, shot in SHOTS.items():
        shown(raw_file(shot, folder / name)).save(ROOT / "docs" / f"camera_{name}.jpg", quality=88, optimize=True)
    addon.unregister()


def raw_file(shot, folder):
    """The raw file of a shot, which is rendered if it does not exist."""
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "sample_scenes" / f"{shot.scene}.blend"))
    scene = bpy.context.scene
    path = folder / f"{scene.name}_{scene.frame_current:04d}_raw.dng"
    if not path.exists():
        scene.render.resolution_x, scene.render.resolution_y = shot.size_px
        scene.cycles.samples = shot.samples
        result = addon.render_through_lens(
            scene, lens=shot.lens, camera=shot.camera, iso=shot.iso, focus=shot.focus_mm, dng=True, view="lens",
            wavelengths_nm=WAVELENGTHS_NM, output_folder=folder, denoise="on", spectral=SpectralOptions("preview"))
        print(*result.messages, sep="\n", flush=True)
    return path


def shown(path):
    """A raw file as LibRaw develops it, with the file's white balance."""
    with rawpy.imread(str(path)) as raw:
        picture = Image.fromarray(raw.postprocess(use_camera_wb=True, no_auto_bright=True))
    picture.thumbnail((SHOWN_PX, SHOWN_PX), Image.Resampling.LANCZOS)
    return picture


if __name__ == "__main__":
    main(Path(sys.argv[1]))
