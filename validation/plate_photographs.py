"""Photographs of measured plates, and Lensfield's pictures of them through lenses made from the camera's calibration.

    python validation/plate_photographs.py FOLDER [PAGE.md PICTURE.jpg]

compares the corners of the plates' squares, which OpenCV finds in both. FOLDER is a clone of
https://github.com/DLR-RM/BlenderProc, whose example of lens distortion has the plates, their photographs, and
calibrations by DLR CalLab. The table in the page is replaced, and the picture is drawn.
"""

import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import scipy
from PIL import Image

from calibration import Calibration, read_calibration
from lensfield import addon
from lensfield.engine.runtime.errors import InputError
from photographs import show, table
from plate_scene import read_plate, render

EXAMPLE = Path("examples", "advanced", "lens_distortion")
PLATES = {"img1": "callab_platte.obj", "img2": "callab_platte_justin.obj"}
SHOWN = "img2"
BLUR_PX, LEAST_WINDOW_PX, MOST_WINDOW_PX = 1.5, 2, 5
FOUND = cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-4
BLACK, WHITE = 64, 192  # of rendered squares, without their blurred edges
GLARE = 0.5  # more light from black relative to white is glare
FITTED, JUDGED = slice(0, None, 2), slice(1, None, 2)
TARGET_PX = 0.5
HEAD = "| photograph | corners | number | RMS | 95 % | largest | within 0.5 px |"
DRAWN_PX, LINE_PX = (1002, 750), 2
COLOURS = {"without distortion": (0, 90, 255), "through the lens": (255, 100, 0)}


@dataclass(frozen=True, eq=False)
class Photograph:
    """A photograph of a plate: uint8 array (row, column), the .obj of the plate, and the Calibration of the camera."""

    name: str
    picture: np.ndarray
    model: Path
    calibration: Calibration


@dataclass(frozen=True, eq=False)
class Comparison:
    """Distances in pixels between corners, by comparison; and the rendered pictures, by camera."""

    photograph: Photograph
    off_px: dict[str, np.ndarray]
    pictures: dict[str, np.ndarray]


def read_photograph(folder, name):
    """The Photograph with a key of `PLATES` in a clone of BlenderProc."""
    example, picture = Path(folder, EXAMPLE), Path(folder, "images", f"lens_{name}_real.png")
    if not picture.is_file():
        raise InputError(picture, "file", "missing", "expected a clone of https://github.com/DLR-RM/BlenderProc")
    return Photograph(name, np.asarray(Image.open(picture).convert("L")), example / PLATES[name],
                      read_calibration(example / f"camera_calibration_callab_{name}.cal"))


def compare(photograph):
    """The Comparison of a photograph with pictures of its plate."""
    calibration = photograph.calibration
    pinhole = calibration.undistorted
    rendered, straight = (render(camera, photograph.model) for camera in (calibration, pinhole))
    corners, windows_px = clear_corners(photograph, rendered)
    true_px, rendered_px = (find_corners(picture, calibration, corners, windows_px)
                            for picture in (photograph.picture, rendered))
    anew = calibrated_anew(calibration, corners[FITTED], true_px[FITTED])
    renewed_px = find_corners(render(anew, photograph.model), anew, corners, windows_px)
    calibrated_px = calibration.project(calibration.tangents(corners))
    off_px = {"rendered without distortion": find_corners(straight, pinhole, corners, windows_px) - true_px,
              "rendered": rendered_px - true_px,
              "by the calibration's equations": calibrated_px - true_px,
              "rendered, calibrated anew": (renewed_px - true_px)[JUDGED],
              "rendered, compared with the equations": rendered_px - calibrated_px}
    return Comparison(photograph, {what: np.hypot(*off.T) for what, off in off_px.items()},
                      dict(zip(COLOURS, (straight, rendered), strict=True)))


def clear_corners(photograph, rendered):
    """The corners of a plate that a photograph shows, without those in glare, and half the sides of their windows."""
    plate, calibration = read_plate(photograph.model), photograph.calibration
    windows_px = free_windows_px(calibration, plate)
    tangents = calibration.tangents(plate.corners)
    clear = calibration.in_frame(tangents, windows_px + 1) & (windows_px >= LEAST_WINDOW_PX)
    places_px = np.rint(calibration.project(tangents)).astype(int)
    for corner in np.flatnonzero(clear):
        (column, row), half = places_px[corner], windows_px[corner]
        window = slice(row - half, row + half + 1), slice(column - half, column + half + 1)
        black, white = (photograph.picture[window][squares].mean()
                        for squares in (rendered[window] < BLACK, rendered[window] > WHITE))
        clear[corner] = black <= GLARE * white
    return plate.corners[clear], windows_px[clear]


def free_windows_px(calibration, plate):
    """Half the sides of windows around corners that contain no other vertex, even blurred: int array (corner,)."""
    corners_px, vertices_px = (calibration.project(calibration.tangents(points))
                               for points in (plate.corners, plate.vertices))
    nearest_px = scipy.spatial.cKDTree(vertices_px).query(corners_px, k=2)[0][:, 1]  # the first is the corner
    return np.clip((nearest_px - BLUR_PX) / np.sqrt(2), 0, MOST_WINDOW_PX).astype(int)


def find_corners(picture, calibration, corners, windows_px):
    """Corners in a picture by OpenCV, from where its calibration has them: array (corner, 2), NaN outside the frame."""
    tangents = calibration.tangents(corners)
    refined_px = np.full((len(corners), 2), np.nan)
    for number in np.flatnonzero(calibration.in_frame(tangents, windows_px + 1)):
        start_px, window = calibration.project(tangents[number, None]), 2 * (int(windows_px[number]),)
        refined_px[number] = cv2.cornerSubPix(picture, start_px[None].astype(np.float32), window, (-1, -1), FOUND)
    return refined_px


def calibrated_anew(calibration, corners, true_px):
    """The Calibration whose place, principal point and radial distortion OpenCV fits to corners in a photograph."""
    k1, k2, k3 = calibration.radial
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_FOCAL_LENGTH | cv2.CALIB_ZERO_TANGENT_DIST
    _, matrix_px, distortion, (turn,), (shift,) = cv2.calibrateCamera(
        [np.float32(corners)], [np.float32(true_px)], calibration.size_px, calibration.matrix_px.copy(),
        np.array([k1, k2, 0, 0, k3]), flags=flags | (0 if k3 else cv2.CALIB_FIX_K3))
    k1, k2, _, _, k3 = distortion.ravel().tolist()
    rotation = cv2.Rodrigues(turn)[0].T
    return replace(calibration, matrix_px=matrix_px, radial=(k1, k2, k3), rotation=rotation,
                   place=-(rotation @ shift).ravel())


def rows(comparison):
    """The lines of the table about a photograph."""
    for what, off_px in comparison.off_px.items():
        off_px = off_px[np.isfinite(off_px)]
        figures = np.sqrt(np.mean(off_px**2)), np.percentile(off_px, 95), off_px.max()
        shown = " | ".join(f"{figure:.2f} px" for figure in figures)
        yield (f"| `{comparison.photograph.name}` | {what} | {off_px.size} | {shown} | "
               f"{100 * np.mean(off_px <= TARGET_PX):.1f} % |")


def draw(comparison, path):
    """Write a photograph with the outlines of the squares: in its left half without distortion, and in its right half
    through the lens."""
    drawn = np.repeat(comparison.photograph.picture[..., None], 3, axis=2)
    middle = drawn.shape[1] // 2
    for half, (how, picture) in zip((np.s_[:, :middle], np.s_[:, middle:]), comparison.pictures.items(), strict=True):
        outlines, _ = cv2.findContours(np.uint8(picture[half] > 127), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        drawn[half] = cv2.drawContours(drawn[half].copy(), outlines, -1, COLOURS[how], LINE_PX)
    Image.fromarray(drawn).resize(DRAWN_PX, Image.Resampling.LANCZOS).save(path, quality=85)


def main(folder, page=None, picture=None):
    addon.register()
    comparisons = {name: compare(read_photograph(folder, name)) for name in PLATES}
    text = table(HEAD, [row for comparison in comparisons.values() for row in rows(comparison)])
    show({HEAD: text}, page)
    if picture:
        draw(comparisons[SHOWN], picture)


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except InputError as error:
        sys.exit(str(error))
    sys.stdout.flush()
    os._exit(0)  # some of Blender's wheels crash while the interpreter exits
