"""An orbit around the sample scene, which COLMAP reconstructs with the exported camera.

    python validation/orbit.py FOLDER [PAGE.md]

renders the scene from places around it to FOLDER, where finished pictures are kept, and exports the camera for COLMAP,
and the cameras of all frames for nerfstudio. COLMAP finds features in the pictures, and reconstructs them with the
exported numbers fixed. The cameras that it finds are compared with those of the scene. The table in the page is
replaced.
"""

import json
import os
import shutil
import sys
from pathlib import Path

import bpy
import numpy as np
import pycolmap
from mathutils import Matrix, Vector

from lensfield.cli import main as lensfield
from lensfield.commands.blend import open_scene
from photographs import show, table

SCENE = Path(__file__).resolve().parents[1] / "sample_scenes" / "evening_chess.blend"
MIDDLE_M, SPREAD_RAD, RISE_M, FRAMES = (0.0, 0.0, 0.038), 0.7, 0.02, 12
RENDERED = ["--f-number", "8", "--lens-quality", "standard"]
PICTURES = ["--tier", "preview", "--resolution", "768x576", "--samples", "48", "--denoise", "on", "--depth", "off"]
HEAD = "| pictures | reconstructed | points | mean reprojection error | cameras off the scene's, RMS | largest turn |"


def orbiting(folder):
    """The scene with a camera that moves around the point in focus, as a .blend in a folder."""
    scene = open_scene(SCENE)
    camera, start = scene.camera, scene.camera.matrix_world.copy()
    for number in range(FRAMES):
        turn = Matrix.Rotation(SPREAD_RAD * (number / (FRAMES - 1) - 0.5), 4, "Z")
        rise = Matrix.Translation((0, 0, RISE_M * np.sin(2 * number)))
        middle = Matrix.Translation(Vector(MIDDLE_M))
        camera.matrix_world = rise @ middle @ turn @ middle.inverted() @ start
        for path in ("location", "rotation_euler"):
            camera.keyframe_insert(path, frame=number + 1)
    path = folder / "orbit.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return path


def run(*words):
    """Run a command of Lensfield; exits if it fails."""
    if lensfield(list(map(str, words))):
        sys.exit(f"lensfield {words[0]} failed")


def taken(folder):
    """Render the orbit and export its cameras: the words of COLMAP's line, and poses by picture."""
    blend, frames = orbiting(folder), f"1-{FRAMES}"
    camera = "lens", "calibration", "--scene", blend, *RENDERED[:2]
    run(*camera, "--for", "colmap", "-o", folder / "cameras.txt")
    run(*camera, "--for", "nerfstudio", "--frames", frames, "-o", folder / "transforms.json")
    run("render", blend, "--frames", frames, "--output", folder / "frames", *RENDERED, *PICTURES)
    line = (folder / "cameras.txt").read_text().splitlines()[-1]
    contents = json.loads((folder / "transforms.json").read_text())
    return line.split(), {each["file_path"]: np.array(each["transform_matrix"]) for each in contents["frames"]}


def reconstructed(folder, camera, names):
    """COLMAP's reconstruction with a camera's words fixed: pycolmap.Reconstruction."""
    _, model, _, _, *parameters = camera
    work, pictures = folder / "colmap", folder / "pictures"
    for each in (work, pictures):
        shutil.rmtree(each, ignore_errors=True)
        each.mkdir()
    for name in names:
        shutil.copy(folder / "frames" / name, pictures)
    database = work / "database.db"
    reader = pycolmap.ImageReaderOptions(camera_model=model, camera_params=",".join(parameters))
    pycolmap.extract_features(database, pictures, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader)
    pycolmap.match_exhaustive(database)
    options = pycolmap.IncrementalPipelineOptions(
        ba_refine_focal_length=False, ba_refine_principal_point=False, ba_refine_extra_params=False)
    models = pycolmap.incremental_mapping(database, pictures, work, options=options)
    return max(models.values(), key=lambda each: each.num_reg_images())


def compared(reconstruction, poses):
    """RMS distance of the cameras from the scene's in mm, and the largest angle between them in degrees, after the
    similarity that fits the distances best."""
    their = {image.name: image.cam_from_world().inverse() for image in reconstruction.images.values()}
    names = sorted(their)
    theirs = np.array([their[name].translation for name in names])
    ours = np.array([poses[name][:3, 3] for name in names])
    turn, scale = _similarity(theirs, ours)
    off_m = scale * (theirs - theirs.mean(axis=0)) @ turn.T - (ours - ours.mean(axis=0))
    flipped = np.diag([1.0, -1, -1])  # COLMAP's cameras look along z, with y downwards
    turned = [poses[name][:3, :3] @ flipped @ (turn @ their[name].rotation.matrix()).T for name in names]
    angles_rad = [np.arccos(np.clip((np.trace(each) - 1) / 2, -1, 1)) for each in turned]
    return 1e3 * np.sqrt(np.mean(np.sum(off_m**2, axis=1))), np.degrees(max(angles_rad))


def _similarity(points, wanted):
    """The rotation and the scale that bring points to the wanted ones (Umeyama, IEEE PAMI 13, 1991)."""
    points, wanted = points - points.mean(axis=0), wanted - wanted.mean(axis=0)
    left, sizes, right = np.linalg.svd(wanted.T @ points)
    signs = np.array([1, 1, np.sign(np.linalg.det(left @ right))])
    return left * signs @ right, (sizes * signs).sum() / (points**2).sum()


def main(folder, page=None):
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    camera, poses = taken(folder)
    reconstruction = reconstructed(folder, camera, poses)
    off_mm, turned_deg = compared(reconstruction, poses)
    text = table(HEAD, [
        f"| {len(poses)} | {reconstruction.num_reg_images()} | {reconstruction.num_points3D()} | "
        f"{reconstruction.compute_mean_reprojection_error():.2f} px | {off_mm:.2f} mm | {turned_deg:.3f}° |"])
    show({HEAD: text}, page)


if __name__ == "__main__":
    main(*sys.argv[1:])
    sys.stdout.flush()
    os._exit(0)  # some of Blender's wheels crash while the interpreter exits
