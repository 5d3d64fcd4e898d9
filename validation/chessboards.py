"""Chessboards through lenses, judged by OpenCV: its calibration of rendered pictures, compared with the exported one.

    python validation/chessboards.py [PAGE.md]

Each lens takes pictures of a board in several places. OpenCV finds the corners in the pictures. Their places are known,
so they show the error of the exported numbers directly; and `calibrateCamera`, which knows nothing of the places,
calibrates the same model from the corners. The table in the page is replaced.
"""

import os
import sys
from dataclasses import dataclass

import cv2
import numpy as np

import truth_scenes
from lensfield import addon
from lensfield.commands.terminal import quiet
from lensfield.engine import Rings, load_lens
from lensfield.engine.calibration.formats import calibrated_for
from lensfield.engine.calibration.rays import frame_rays
from lensfield.engine.field.field_map import field_map
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.inspection.curves import reference_nm
from lensfield.engine.lens.pinhole import fitting_pitch_um
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.runtime.files import temporary_folder
from lensfield.engine.stray.options import OFF, StrayOptions
from photographs import show, table

LENSES = "tessar-50mm", "nikkor-58mm-f1.4", "nikkor-28mm", "pentax-fisheye-17mm"
FRAME_PX, FOCUS_MM, F_NUMBER = (640, 960), 2000.0, 8.0  # rows and columns
CORNERS = 9, 6  # inner corners along a row of the board, and along a column
WITH_BORDER = np.add(CORNERS, 3) / np.subtract(CORNERS, 1)  # times the sides of the inner corners
PLACES = [(across, down) for down in (-0.45, 0.0, 0.45) for across in (-0.5, 0.0, 0.5)]  # in half sides of the frame
SPAN = 0.5  # of the board: half its diagonal over half the frame's
LEAN = 0.45  # of a board's normal, as a tangent
BORDER_PX, SMALLER = 8, 0.9
SAMPLES = 64
HEAD = ("| lens | model | residual, RMS (largest) | exact corners by OpenCV, RMS | corners found | from the exported "
        "numbers, RMS | after OpenCV's own calibration, RMS | OpenCV's focal length |")
FIND = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
STOP = cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-12


@dataclass(frozen=True, eq=False)
class Board:
    """A board in front of a camera: its side of a square, and the turn and shift from its axes to the camera's, to the
    right, down and forwards, in metres."""

    square_m: float
    turn: np.ndarray
    shift_m: np.ndarray

    @property
    def corners_m(self):
        """Inner corners on the board: float32 array (corner, 3)."""
        across, down = CORNERS
        columns, rows = np.meshgrid(np.arange(across) - (across - 1) / 2, np.arange(down) - (down - 1) / 2)
        return np.float32(self.square_m * np.stack([columns, rows, 0 * rows], axis=-1).reshape(-1, 3))

    def in_camera(self, points_m):
        return points_m @ self.turn.T + self.shift_m


def boards(calibration, rays):
    """Boards all over a frame, by its FrameRays, that lean differently, each completely visible."""
    rows, columns = FRAME_PX
    placed = []
    for number, (across, down) in enumerate(PLACES):
        middle_px = (columns - 1) / 2 * (1 + across), (rows - 1) / 2 * (1 + down)
        towards = rays.directions[np.argmin(np.hypot(*(rays.pixels - middle_px).T))]
        angle = 2.4 * number  # no two boards lean alike
        normal = towards / np.linalg.norm(towards) + LEAN * np.array([np.cos(angle), np.sin(angle), 0])
        square_m = SPAN * FOCUS_MM * 1e-3 * np.hypot(rows, columns) / calibration.focal_px[1] / np.hypot(*CORNERS)
        shift_m = towards * FOCUS_MM * 1e-3 / np.linalg.norm(towards)
        placed.append(_visible(calibration, square_m, _turn(normal), shift_m))
    return placed


def _visible(calibration, square_m, turn, shift_m):
    """The largest board up to this size whose squares and border are all in the frame."""
    while True:
        board = Board(square_m, turn, shift_m)
        outer = board.in_camera(board.corners_m * (*WITH_BORDER, 1))
        inside = np.all(np.abs(calibration.pixels(outer) - np.subtract(FRAME_PX[::-1], 1) / 2)
                        < np.array(FRAME_PX[::-1]) / 2 - BORDER_PX, axis=1)
        if inside.all() and np.all(outer[:, 2] > 0):
            return board
        square_m *= SMALLER


def _turn(normal):
    """A rotation whose third column is along a normal."""
    forwards = normal / np.linalg.norm(normal)
    right = np.cross([0.0, 1, 0], forwards)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forwards, right), forwards], axis=1)


def picture_of(board, lens):
    """Lensfield's picture of a board: uint8 array (row, column)."""
    scene = truth_scenes.empty_scene()
    scene.render.resolution_y, scene.render.resolution_x = FRAME_PX
    scene.cycles.samples = SAMPLES
    _add(scene, board)
    with temporary_folder() as folder, quiet(1):
        result = addon.render_through_lens(scene, lens=lens, wavelengths_nm=[reference_nm(lens)], output_folder=folder,
                                           stray=StrayOptions(OFF))
        light = read_exr(result.irradiance).cube[0]
    return np.uint8(np.rint(np.clip(230 * light / np.percentile(light, 99), 0, 255)))


def _add(scene, board):
    """The light squares of a board, and a light border, as a mesh."""
    across, down = CORNERS
    squares = [(column, row) for row in range(-1, down + 2) for column in range(-1, across + 2)
               if (column + row) % 2 or not (0 <= column <= across and 0 <= row <= down)]
    quads = np.array([[(column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1)]
                      for column, row in squares], float) - (np.array(CORNERS) + 1) / 2
    points = board.in_camera(board.square_m * np.concatenate([quads, 0 * quads[..., :1]], axis=-1).reshape(-1, 3))
    truth_scenes.add_mesh(scene, "Board", points * (1, -1, -1), np.arange(len(points)).reshape(-1, 4),
                          truth_scenes.glow("Light"))


def detected_px(picture, exact_px):
    """The corners that OpenCV finds in a picture, in the board's order, or None."""
    complete, corners = cv2.findChessboardCornersSB(picture, CORNERS, flags=FIND)
    if not complete:
        return None
    corners = corners[:, 0]
    turned = corners[::-1]  # the board looks the same turned by half a turn
    return corners if np.abs(corners - exact_px).sum() < np.abs(turned - exact_px).sum() else turned


def exact_px(lens, frame, nm, points):
    """Columns and rows at which the chief rays of points in front of the camera land."""
    focal_mm, (x, y, z) = lens.capture_focal_length_mm, points.T
    row, column = frame.index_of(*field_map(lens).at_wavelength(nm).landing_mm(
        focal_mm / lens.squeeze * x / z, -focal_mm * y / z))
    return np.stack([column, row], axis=1)


def opencv_calibration(calibration, detected):
    """OpenCV's RMS in pixels and camera matrix for the same model, from (corners on a board, their pixels)."""
    points, pixels = ([np.float64(each)[:, None] for each in part] for part in zip(*detected, strict=True))
    if calibration.model.fisheye:
        flags = cv2.fisheye.CALIB_RECOMPUTE_EXTRINSIC | cv2.fisheye.CALIB_FIX_SKEW
        rms_px, matrix, *_ = cv2.fisheye.calibrate(points, pixels, calibration.size_px, np.eye(3), np.zeros(4),
                                                   flags=flags, criteria=STOP)
    else:
        flags = cv2.CALIB_FIX_K3 if len(calibration.model.coefficients) < 3 else 0
        rms_px, matrix, *_ = cv2.calibrateCamera([np.float32(each) for each in points],
                                                 [np.float32(each) for each in pixels], calibration.size_px, None, None,
                                                 flags=flags, criteria=STOP)
    return rms_px, matrix


def taken_lens(name):
    """A lens, focused and stopped down, its frame, and the wavelength in nm."""
    lens = load_lens(name, Rings(FOCUS_MM, F_NUMBER))
    return lens, PixelGrid(FRAME_PX, fitting_pitch_um(lens, FRAME_PX)), reference_nm(lens)


def row(name):
    """The line of the table about a lens."""
    lens, frame, nm = taken_lens(name)
    calibration = calibrated_for("opencv", lens, frame, nm)
    detected, exact = [], []
    for board in boards(calibration, frame_rays(lens, frame, nm)):
        exact.append((board.corners_m, exact_px(lens, frame, nm, board.in_camera(board.corners_m))))
        corners_px = detected_px(picture_of(board, lens), exact[-1][1])
        if corners_px is not None:
            detected.append((board, corners_px))
    off_px = np.concatenate([np.hypot(*(calibration.pixels(board.in_camera(board.corners_m)) - corners_px).T)
                             for board, corners_px in detected])
    exact_rms_px, _ = opencv_calibration(calibration, exact)
    opencv_rms_px, matrix = opencv_calibration(calibration, [(board.corners_m, px) for board, px in detected])
    change = matrix[1, 1] / calibration.focal_px[1] - 1
    residual = f"{calibration.rms_px:.3f} px ({calibration.largest_px:.3f} px)"
    return (f"| {lens.name} | {calibration.model.name} | {residual} | {exact_rms_px:.3f} px | {off_px.size} | "
            f"{np.sqrt(np.mean(off_px**2)):.3f} px | {opencv_rms_px:.3f} px | {change:+.2%} |")


def main(page=None):
    addon.register()
    text = table(HEAD, [row(name) for name in LENSES])
    show({HEAD: text}, page)


if __name__ == "__main__":
    main(*sys.argv[1:])
    sys.stdout.flush()
    os._exit(0)  # some of Blender's wheels crash while the interpreter exits
