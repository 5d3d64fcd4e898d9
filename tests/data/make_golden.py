"""Write a file of every format of this version of Lensfield, small, into a folder of its own: tests/data/golden-0.1.0.

    HOME=/tmp .venv/bin/python tests/data/make_golden.py

Later versions must read these files, and find what `facts.json` states. Run it once for each version that changes a
format, before its release, with Blender's wheel. Never run it again for 0.1.0, or for any other version that has been
released: files that its users have are as they are. It refuses to write into a folder that exists. Blender
stores the folder HOME in .blend files.
"""

import json
import os
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / folder) for folder in ("tests/support", "tests/stand_ins")]

from golden import FACTS, READERS, RECORDED_JOB, facts_of  # noqa: E402
from golden_blend import facts_of_scene, fill, write_preset  # noqa: E402
from lenses import comatic_lens, lopsided_grid  # noqa: E402
from lensfield import Projection, SpectralImage, __version__, load_camera, write_exr, write_package  # noqa: E402
from lensfield.engine.image.detail import Detail  # noqa: E402
from lensfield.engine.image.layers import Layer, LayeredRadiance  # noqa: E402
from lensfield.engine.image.pixel_grid import PixelGrid  # noqa: E402
from lensfield.engine.image.sources import Sources  # noqa: E402
from lensfield.engine.pictures.frame_record import write_record  # noqa: E402
from lensfield.engine.prescription.readers import read_prescription  # noqa: E402
from lensfield.engine.prescription.readers.toml import write_prescription  # noqa: E402
from lensfield.engine.sensor.camera_file import camera_text  # noqa: E402
from places import DATA  # noqa: E402
from vendor_files import export_folder, exported_lens  # noqa: E402

NM, FRAME_PX, OVERSCAN_PX = (500.0, 600.0), (6, 8), (1, 2)
ORIGIN = {"lensfield:origin": '{"file": "shot.blend", "scene": "Scene", "key": "k", "state": ""}'}
PRESCRIPTION = """
format = "lensfield-prescription"
version = 1
title = "Golden 50 mm f/4"
maker = "Nobody"
year = 2026
character = ["soft"]
story = "Made up."
source = "Made up."
aperture = { f_number = 4 }
field = { angle_deg = 20 }
sensor_mm = [36, 24]
focus = "paraxial"
coating = "multi"
provenance = { figures = "guessed" }
photographs.source = "Made up"
photographs.date = "2026-11-29"
photographs.illumination = 0.02
image_pose = { tilt_deg = [1, 0, 0] }
surfaces = [
  { radius_mm = 30, thickness_mm = 5, glass = "N-BK7", semi_aperture_mm = 14, conic = -0.5, aspheric = { 4 = 1e-6 } },
  { radius_mm = -200, thickness_mm = 2, semi_aperture_mm = 14, coating = "V" },
  { thickness_mm = 6, stop = true },
  { radius_mm = 90, radius_x_mm = 80, thickness_mm = 4, glass = "MINE", half_widths_mm = [12, 9] },
  { radius_mm = -60, thickness_mm = 40, pose = { offset_mm = [0.02, 0, 0], tilt_deg = [0, 0.1, 0] } } ]

[glasses.MINE]
formula = 2
coefficients = [0, 1.03961212, 0.00600069867, 0.231792344, 0.0200179144, 1.01046945, 103.560653]
range_nm = [300, 2500]

[[coatings]]
name = "V"
layers = [[1.38, 128], [2.1, 24]]

[[photographs.light]]
f_number = 4
focus_mm = inf
heights_mm = [3.2, 9.7, 15.9]
light = [0.982, 0.871, 0.702]
"""
FILM = """format = "lensfield-film"
version = 1
name = "Golden"
unit = "erg/cm2"
wavelengths_nm = [400, 550, 700]
log_exposure = [-2, 0, 1]
[log_sensitivity]
red = [-3, -1, 0.5]
blue = [0.9, -0.5, -3]
[density]
red = [0.2, 0.8, 1.6]
blue = [0.1, 0.7, 1.5]
"""


def write_lenses(folder):
    write_package(comatic_lens(heights=3), folder / "lens.npz")
    write_package(lopsided_grid(), folder / "grid_lens.npz")
    export_folder(folder / "export", exported_lens(heights=2), "zospy")
    draft = folder / "prescription.toml"
    draft.write_text(PRESCRIPTION, encoding="utf-8")
    draft.write_text(write_prescription(read_prescription(draft)), encoding="utf-8")


def write_cameras(folder):
    (folder / "camera.toml").write_text(camera_text(load_camera("sony-a7-iv")), encoding="utf-8")
    (folder / "film.toml").write_text(FILM, encoding="utf-8")


def write_pictures(folder):
    rng = np.random.default_rng(1)
    grid = PixelGrid.around_frame(FRAME_PX, 5.5, OVERSCAN_PX)

    def light(shape_px, waves=2):
        return rng.random((waves, *shape_px), dtype=np.float32)

    near = Layer(light((3, 4)), np.full((3, 4), 0.5, np.float32), np.full((3, 4), 812.5, np.float32), (1, 2))
    far = Layer(light(grid.shape_px), np.ones(grid.shape_px, np.float32),
                np.full(grid.shape_px, np.inf, np.float32), (0, 0))
    layered = LayeredRadiance((near, far), NM, grid, 49.5, 1.5)
    shares = np.tile(np.array([[0.5, 1.5], [1.25, 0.75]], np.float16), (1, *grid.shape_px))
    picture = SpectralImage(light(grid.shape_px), NM, grid, focal_mm=49.5, exposure=1.5,
                            detail=Detail(np.array([550.0]), shares, 2))
    sources = Sources(np.array([[0.6, 0.0, 0.8]]), np.array([np.inf]), np.array([[1.0, 2.0]]), np.array(NM),
                      np.array([0.004]), ("Sun",))
    planes = {"A": np.linspace(0, 1, grid.shape_px[0] * grid.shape_px[1]).reshape(grid.shape_px), "Z": 2 * light(
        grid.shape_px, 1)[0]}
    write_exr(picture, folder / "radiance.exr", planes, layered, sources, attributes=ORIGIN)
    write_exr(SpectralImage(light(FRAME_PX), NM, pitch_um=6, squeeze=1.8, focal_mm=20.0,
                            projection=Projection((1.0, -0.01, 0.002))), folder / "panorama.exr")
    on_sensor = dict(pitch_um=6, quantity="irradiance", lens_name="hand-made", f_number_effective=2.2)
    write_exr(SpectralImage(light(FRAME_PX), NM, **on_sensor), folder / "irradiance.exr",
              stray=SpectralImage(light(FRAME_PX) / 100, NM, **on_sensor))
    write_record(folder / "shot_Scene_0001_report.json", RECORDED_JOB, [folder / "radiance.exr"], {"state": "5.0 0"})


def write_scene(folder):
    """The .blend is written to a folder whose name may be known: Blender stores it in the file."""
    import bpy

    from lensfield import addon

    addon.register()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    facts = facts_of_scene(fill())
    with tempfile.TemporaryDirectory() as temporary:
        bpy.ops.wm.save_as_mainfile(filepath=str(Path(temporary, "scene.blend")), compress=True)
        shutil.copy(Path(temporary, "scene.blend"), folder)
        shutil.copy(write_preset(temporary), folder / "preset.py")
    return facts


def main():
    finished = DATA / f"golden-{__version__}"
    if finished.exists():
        sys.exit(f"{finished.relative_to(ROOT)} exists: files of a version that users have never change")
    with tempfile.TemporaryDirectory(dir=DATA) as temporary:
        folder = Path(temporary, finished.name)
        folder.mkdir()
        write_all(folder)
        folder.rename(finished)


def write_all(folder):
    write_lenses(folder)
    write_cameras(folder)
    write_pictures(folder)
    facts = {"scene.blend": write_scene(folder)} | {
        path.relative_to(folder).as_posix(): facts_of(path)
        for path in sorted(folder.rglob("*")) if path.name in READERS}
    (folder / FACTS).write_text(json.dumps(facts, indent=0) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)  # some of Blender's wheels crash while the interpreter exits
