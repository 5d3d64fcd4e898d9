"""`lensfield coco`: which files it takes, and bad input."""

import json
import sys

import numpy as np
import pytest
from PIL import Image

from lensfield.cli import main
from lensfield.engine.pictures.spectral_exr import write_layers_exr
from lensfield.engine.truth.captured_truth import ShownObject
from lensfield.engine.truth.coco import OBJECTS, objects_from, objects_text
from lensfield.engine.truth.cryptomatte import id_of

CUBE = {"Cube": ShownObject(2, 1)}


def frame(folder, name, objects=CUBE, ids=None, channel="Layer.Object.X", size_px=(6, 5), text=None):
    """Write a frame's picture and ground truth, with a cube in the upper left corner."""
    folder.mkdir(parents=True, exist_ok=True)
    if ids is None:
        ids = np.zeros((5, 6), np.float32)
        ids[:2, :3] = id_of("Cube")
    write_layers_exr({channel: ids}, folder / f"{name}_truth.exr", {OBJECTS: text or objects_text(objects)})
    Image.new("RGB", size_px).save(folder / f"{name}_after.png")


def run(folder, capsys, *arguments):
    """The exit status, the last line printed, and the annotations."""
    path = folder / "out" / "annotations.json"
    status = main(["coco", *map(str, arguments or [folder]), "-o", str(path)])
    printed = capsys.readouterr()
    return status, (printed.out + printed.err).strip().splitlines()[-1], status or json.loads(path.read_text())


@pytest.fixture(autouse=True)
def coder():
    pytest.importorskip("pycocotools", reason="pycocotools is not installed")


def test_frames_of_all_folders_are_in_their_order(tmp_path, capsys):
    for name in ("shot_0002", "shot_10000", "shot_-001"):
        frame(tmp_path / "a" / "b", name)
    frame(tmp_path / "c", "shot_0001", {"Cube": ShownObject(7, 1), "Hidden": ShownObject(4, 1)})
    (tmp_path / "c" / "old_truth.exr").write_bytes(b"")  # not a frame
    status, line, coco = run(tmp_path, capsys, tmp_path / "c", tmp_path / "a")
    assert status == 0 and line.endswith("annotations.json: pictures: 4, annotations: 4")
    names = [each["file_name"] for each in coco["images"]]
    assert names == [f"../{name}_after.png" for name in ("a/b/shot_-001", "a/b/shot_0002", "a/b/shot_10000",
                                                          "c/shot_0001")]
    assert [each["category_id"] for each in coco["annotations"]] == [2, 2, 2, 7]
    assert [each["id"] for each in coco["annotations"]] == [1, 2, 3, 4] == [each["id"] for each in coco["images"]]
    assert coco["annotations"][0]["bbox"] == [0, 0, 3, 2] and coco["annotations"][0]["area"] == 6
    assert [each["id"] for each in coco["categories"]] == [2, 4, 7], "also those that no pixel shows"
    first = (tmp_path / "out" / "annotations.json").read_bytes()
    assert run(tmp_path, capsys)[0] == 0 and (tmp_path / "out" / "annotations.json").read_bytes() == first


@pytest.mark.parametrize("given, arguments, line", [
    ({"channel": "Layer.Depth.Z"}, (), "shot_0001_truth.exr: channel Object.X is missing: render with --truth object"),
    ({"text": "[1"}, (), "shot_0001_truth.exr: lensfield:objects is damaged: render with --truth object again"),
    ({"text": 9999 * "["}, (), "lensfield:objects is damaged: render with --truth object again"),
    ({"text": '{"Cube": [1]}'}, (), "lensfield:objects is damaged: render with --truth object again"),
    ({"text": '{"Cube": [1, "2"]}'}, (), "lensfield:objects is damaged: render with --truth object again"),
    ({"objects": {"Sphere": ShownObject(1, 1)}}, (), "shot_0001_truth.exr: objects is 1 without a name: render the "
                                                     "frame again"),
    ({"size_px": (6, 4)}, (), "shot_0001_after.png: size is 6 x 4: expected the 6 x 5 px of its ground truth: render "
                              "the frame again"),
    ({"objects": {"Cube": ShownObject(0, 1)}}, (), "options: --category is id: no object has a pass index or a "
                                                   "category_id: set them and render again, or use --category object"),
    ({}, ("--names", "chair"), "options: --names is chair: expected numbers and names, such as 1=chair,2=lamp"),
    ({}, ("--names", "1=a", "--category", "object"), "options: --names is 1=a: leave it out, or use --category id")])
def test_bad_input_is_one_line(tmp_path, capsys, given, arguments, line):
    frame(tmp_path, "shot_0001", **given)
    status, printed, _ = run(tmp_path, capsys, tmp_path, *arguments)
    assert status == 1 and printed.endswith(line)


def test_named_categories_are_listed_also_without_objects(tmp_path, capsys):
    frame(tmp_path, "shot_0001")
    _, _, coco = run(tmp_path, capsys, tmp_path, "--names", "1=chair, 2=cube")
    assert {each["id"]: each["name"] for each in coco["categories"]} == {1: "chair", 2: "cube"}


def test_missing_and_damaged_pictures_are_reported(tmp_path, capsys):
    assert "ground truth is missing: render with --truth object" in run(tmp_path, capsys)[1]
    assert "absent: folder is missing: expected a folder of renders" in run(tmp_path, capsys, tmp_path / "absent")[1]
    (tmp_path / "one.exr").write_text("")
    assert "one.exr: folder is a file: expected a folder of renders" in run(tmp_path, capsys, tmp_path / "one.exr")[1]
    frame(tmp_path, "shot_0001")
    picture = tmp_path / "shot_0001_after.png"
    picture.write_bytes(picture.read_bytes()[:20])
    assert "shot_0001_after.png: file is not readable: expected a PNG" in run(tmp_path, capsys)[1]
    picture.unlink()
    assert "shot_0001_after.png: file is missing: render the frame again" in run(tmp_path, capsys)[1]


def test_without_pycocotools_one_line_names_it(tmp_path, capsys, monkeypatch):
    frame(tmp_path, "shot_0001")
    monkeypatch.setitem(sys.modules, "pycocotools", None)
    line = "lensfield coco: pycocotools is not installed: pip install pycocotools"
    status, printed, _ = run(tmp_path, capsys)
    assert status == 1 and printed.endswith(line)


def test_the_attribute_keeps_all_names():
    objects = {"B\u00e4ll\x1b \"quoted\"": ShownObject(3, 2), "": ShownObject(0, 1)}
    assert objects_from(objects_text(objects)) == objects and objects_text(objects).isascii()
