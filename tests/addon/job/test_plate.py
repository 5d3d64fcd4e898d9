"""A plate in front of a calibrated camera: its place in Lensfield's picture; and a new comparison with photographs."""

import importlib
import os
import re

import numpy as np
import pytest

from calibration import Calibration
from lensfield.engine.runtime.errors import InputError
from places import ROOT
from plate_scene import read_plate, render
from refusals import refused

SAMPLES, HALF_M, HALF_PX = 1024, 0.025, 5
LEAN = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, -0.6], [0.0, 0.6, 0.8]])
ROLL = np.array([[0.96, -0.28, 0.0], [0.28, 0.96, 0.0], [0.0, 0.0, 1.0]])
CAMERA = Calibration("made", (120, 80), np.array([[90.0, 0, 66.3], [0, 90, 33.6], [0, 0, 1]]), (-0.2, 0.05, 0.0),
                     (0.0, 0.0), LEAN @ ROLL, np.array([0.1, 0.35, -0.45]))
PLACES_M = (0.0, 0.0), (-0.2, 0.08), (0.18, -0.04), (-0.16, -0.1), (0.3, 0.06)
FIGURE = re.compile(r"(\d+(?:\.\d+)?)( px| %)(?= \|)")
ROUNDING = {" px": 0.021, " %": 0.51}  # on other processors


def write_model(path, faces):
    """Write an .obj of (material, corners) faces, and its .mtl."""
    path.with_suffix(".mtl").write_text("newmtl Black\nKd 0 0 0\nKs 0 0 0\nnewmtl White\nKd 1 1 1\nKs 0 0 0\n")
    number = {vertex: index for index, vertex in enumerate(dict.fromkeys(sum((face for _, face in faces), [])), 1)}
    lines = [f"mtllib {path.stem}.mtl", "o Plate", *("v {} {} {}".format(*vertex) for vertex in number)]
    for material, face in faces:
        lines += [f"usemtl {material}", f"f {' '.join(str(number[vertex]) for vertex in face)}"]
    path.write_text("\n".join(lines) + "\n")
    return path


def square(x, y, half):
    """The corners of a square at z = 0 that faces -z."""
    return [(round(x + across * half, 6), round(y + up * half, 6), 0.0)  # equal for neighbours
            for across, up in ((-1, -1), (-1, 1), (1, 1), (1, -1))]


def image_of(x, y):
    """Column and row of a point (x, y, 0) on the plate, by OpenCV's equations."""
    right, down, forwards = ROLL.T @ LEAN.T @ np.array([x - 0.1, y - 0.35, 0.45])
    right, down = right / forwards, down / forwards
    scale = 1 - 0.2 * (right**2 + down**2) + 0.05 * (right**2 + down**2)**2
    return 66.3 + 90 * scale * right, 33.6 + 90 * scale * down


def middle_of(place):
    """The middle of the image of a square, by its rim."""
    corners = np.array(square(*place, HALF_M))[:, :2]
    share = np.linspace(0, 1, 32, endpoint=False)[:, None]
    rim = np.concatenate([(1 - share) * one + share * other
                          for one, other in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    here = np.array([image_of(*point) for point in rim])
    following = np.roll(here, -1, axis=0)
    areas = here[:, 0] * following[:, 1] - here[:, 1] * following[:, 0]
    return (areas @ (here + following)) / (3 * areas.sum())


def test_squares_are_where_opencv_has_them(tmp_path):
    model = write_model(tmp_path / "squares.obj", [("White", square(*place, HALF_M)) for place in PLACES_M])
    light = render(CAMERA, model, SAMPLES).astype(float)
    row, column = np.indices(light.shape)
    side_px = 2 * HALF_PX
    noise = 0.5 / np.sqrt(SAMPLES)  # at most, of the share of a pixel at the rim that is white
    tolerance_px = 5 * noise * np.sqrt(4 * side_px) * HALF_PX / side_px**2
    for place in PLACES_M:
        expected = middle_of(place)
        near = light * (np.maximum(abs(column - expected[0]), abs(row - expected[1])) < 10)
        middle = np.array([np.average(index, weights=near) for index in (column, row)])
        assert np.abs(middle - expected).max() < tolerance_px, place


def test_corners_are_where_four_squares_meet(tmp_path):
    """Not at the plate's edge, on its back, or around a circle, here an octagon, in a square."""
    faces = [("Black" if (column + row) % 2 else "White", square(0.1 * column, 0.1 * row, 0.05))
             for column in range(4) for row in range(3) if (column, row) != (1, 1)]
    outside = square(0.1, 0.1, 0.05)
    turns = np.radians(225) - np.radians(45) * np.arange(8)
    circle = [(0.1 + 0.03 * np.cos(turn), 0.1 + 0.03 * np.sin(turn), 0.0) for turn in turns]
    faces.append(("Black", circle))
    for side in range(4):
        begin, middle, end = (circle[(2 * side + step) % 8] for step in range(3))
        faces.append(("White", [outside[side], outside[(side + 1) % 4], end, middle, begin]))
    faces += [(material, [(x, y, 0.01) for x, y, _ in face]) for material, face in faces]
    plate = read_plate(write_model(tmp_path / "chequer.obj", faces))
    expected = [(0.05 + 0.1 * column, 0.05 + 0.1 * row, 0.0) for column in range(3) for row in range(2)]
    assert np.array(sorted(plate.corners.round(6).tolist())) == pytest.approx(np.array(expected), abs=1e-5)
    assert len(plate.vertices) == 20 + 8 and not plate.vertices[:, 2].any()


@pytest.fixture
def comparison():
    """The module that needs OpenCV, and the folder that the user names."""
    pytest.importorskip("cv2", reason="needs OpenCV: make test-plate PLATE=FOLDER")
    if not os.environ.get("PLATE"):
        pytest.skip("needs a clone of BlenderProc: make test-plate PLATE=FOLDER")
    return importlib.import_module("plate_photographs"), os.environ["PLATE"]


def test_the_page_has_the_figures_of_a_new_comparison(comparison):
    plate, folder = comparison
    page = (ROOT / "docs" / "photographs.md").read_text(encoding="utf-8")
    stated = page.split(plate.HEAD + "\n", 1)[1].split("\n\n")[0].splitlines()[1:]
    renewed = [row for name in plate.PLATES for row in plate.rows(plate.compare(plate.read_photograph(folder, name)))]
    for old, new in zip(stated, renewed, strict=True):
        assert FIGURE.sub("", old) == FIGURE.sub("", new)
        for (figure, unit), (other, _) in zip(FIGURE.findall(old), FIGURE.findall(new), strict=True):
            assert abs(float(figure) - float(other)) <= ROUNDING[unit], f"{old} against {new}"


def test_a_folder_without_photographs_is_refused(comparison, tmp_path):
    with refused(InputError, field="file", where="lens_img1_real.png", match="BlenderProc"):
        comparison[0].read_photograph(tmp_path, "img1")
