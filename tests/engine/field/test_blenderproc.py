"""BlenderProc's pictures through lenses, compared with the field map: a board whose colours are its coordinates.

`make test-blenderproc` runs this in an environment with BlenderProc; in others, it is skipped.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lensfield.engine import Rings, load_lens
from lensfield.engine.field.stmap import distort_map
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.inspection.curves import reference_nm
from lensfield.engine.lens.pinhole import fitting_pitch_um
from places import ROOT

COMMAND = Path(sys.executable).with_name("blenderproc")
BLENDER = ROOT / ".venv-blenderproc"
pytestmark = pytest.mark.skipif(not COMMAND.exists(), reason="BlenderProc is not installed: make test-blenderproc")

FRAME_PX, AXIS_PX = (90, 140), (40.0, 73.5)
FOCUS_MM, F_NUMBER = 2000.0, 8.0
DISTANCE_M = 3.0
RENDER_BOARD = f"""
import blenderproc as bproc
import numpy as np
import sys
from lensfield import Rings
from lensfield.blenderproc import set_lens_distortion

bproc.init()
board = bproc.object.create_primitive("PLANE", location=[0, 0, -{DISTANCE_M}])
board.set_scale([20, 20, 1])
tree = board.new_material("Coordinates").blender_obj.node_tree
place, shader = (tree.nodes.new(f"ShaderNode{{name}}") for name in ("NewGeometry", "Emission"))
tree.links.new(place.outputs["Position"], shader.inputs["Color"])
tree.links.new(shader.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
bproc.camera.add_camera_pose(np.eye(4))
bproc.camera.set_intrinsics_from_K_matrix(
    [[200, 0, {AXIS_PX[1]}], [0, 200, {AXIS_PX[0]}], [0, 0, 1]], {FRAME_PX[1]}, {FRAME_PX[0]})
map_px = set_lens_distortion(sys.argv[1], Rings({FOCUS_MM}, {F_NUMBER}), quality="preview")
bproc.renderer.set_max_amount_of_samples(1)
bproc.renderer.set_denoiser(None)
bproc.renderer.set_output_format("OPEN_EXR", 32, view_transform="Raw")
picture = bproc.renderer.render()["colors"][0]
distorted = bproc.postprocessing.apply_lens_distortion(picture.astype(np.float32), map_px, {FRAME_PX[1]}, {FRAME_PX[0]})
np.savez(sys.argv[2], distorted=distorted, rendered_px=picture.shape[:2])
"""


def run_in_blender(folder, text, *arguments):
    """Run a script by `blenderproc run`."""
    script = folder / "script.py"
    script.write_text(text.lstrip(), encoding="utf-8")
    completed = subprocess.run([COMMAND, "run", "--custom-blender-path", BLENDER, script, *arguments],
                               capture_output=True, text=True, cwd=folder)
    assert completed.returncode == 0, completed.stdout + completed.stderr
    return completed.stdout


@pytest.mark.parametrize("name", ["nikkor-28mm", "jacobsen-41mm-2x", "pentax-fisheye-17mm"])
def test_a_board_is_where_the_lens_shows_it(tmp_path, name):
    run_in_blender(tmp_path, RENDER_BOARD, name, tmp_path / "board.npz")
    written = np.load(tmp_path / "board.npz")
    shown_m = written["distorted"][..., :2]

    lens = load_lens(name, Rings(FOCUS_MM, F_NUMBER))
    frame = PixelGrid(FRAME_PX, fitting_pitch_um(lens, FRAME_PX), centre_px=AXIS_PX)
    s, t, _ = np.moveaxis(distort_map(lens, frame, reference_nm(lens)).astype(float), -1, 0)
    x_mm, y_mm = frame.position_mm((1 - t) * FRAME_PX[0] - 0.5, s * FRAME_PX[1] - 0.5)
    pixel_m = frame.pitch_um * 1e-3 * DISTANCE_M / lens.capture_focal_length_mm
    expected_m = np.stack([x_mm * lens.squeeze, y_mm], axis=-1) * DISTANCE_M / lens.capture_focal_length_mm
    missed_px = np.abs(shown_m - expected_m) / (pixel_m * np.array([lens.squeeze, 1]))
    assert missed_px.max() < 0.02
    row, column = written["rendered_px"]
    assert row > FRAME_PX[0] and column > FRAME_PX[1]


def test_a_pinhole_picture_that_is_too_large_is_refused(tmp_path):
    printed = run_in_blender(tmp_path, """
import blenderproc as bproc
import lensfield.blenderproc

bproc.init()
bproc.camera.set_resolution(160, 120)
lensfield.blenderproc.MOST_PX = 160
try:
    lensfield.blenderproc.set_lens_distortion("pentax-fisheye-17mm", quality="preview")
except lensfield.InputError as error:
    print(error)
""")
    assert "pentax-fisheye-17mm: pinhole picture is of " in printed
    assert "expected at most 160 on a side: use a lower resolution, or lensfield render" in printed
