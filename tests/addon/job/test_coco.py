"""Annotations of rendered objects, read by pycocotools."""

import bpy
import numpy as np
import pytest

from lensfield import addon, cli
from lensfield.addon.scene.errors import SceneError
from lensfield.engine.pictures.spectral_exr import read_parts
from refusals import refused
from small_scenes import material

coco_module = pytest.importorskip("pycocotools.coco", reason="pycocotools is not installed")
QUICK = {"lens": "edmund-54852", "lens_quality": "preview", "wavelengths_nm": [550.0], "files": "pictures",
         "depth": "off", "truth": "index,object"}


def ball(name, place, radius=0.12, index=0):
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3, radius=radius, location=place)
    new = bpy.context.object
    new.name, new.pass_index = name, index
    new.data.materials.append(material(name, "ShaderNodeEmission")[0])
    return new


@pytest.fixture
def balls(scene):
    """Two balls, one partly in front of the other, and one that is not annotated; the axis is off the middle."""
    scene.cycles.samples = 2
    scene.camera.location = 0.5, -0.25, 3.0
    scene.camera.data.shift_x = 0.05
    return [ball("Near", (0.4, -0.3, 0.3), index=3), ball("B\u00e4ll", (0.46, -0.2, 0.0), 0.2, index=9),
            ball("Background", (1.0, 0.1, 0.0))]


def annotated(scene, folder, *arguments, frames=(1,), **given):
    """The annotations of rendered frames, by pycocotools, and the index plane of each."""
    planes = []
    for frame in frames:
        result = addon.render_through_lens(scene, frame=frame, output_folder=folder, **QUICK | given)
        (_, channels), = read_parts(result.truth)
        planes.append(next(plane for name, plane in channels.items()
                           if name.endswith((".Object Index.X", ".IndexOB.X"))))
    path = folder / "annotations.json"
    assert cli.main(["coco", str(folder), "-o", str(path), *arguments]) == 0
    return coco_module.COCO(str(path)), planes


def test_masks_and_boxes_are_those_of_the_index(balls, scene, tmp_path):
    balls[0].location.x = 0.4
    balls[0].keyframe_insert("location", frame=1)
    balls[0].location.x = 0.6
    balls[0].keyframe_insert("location", frame=2)
    coco, planes = annotated(scene, tmp_path, "--names", "3=near,9=far", frames=(1, 2))
    assert {each["id"]: each["name"] for each in coco.cats.values()} == {3: "near", 9: "far"}
    assert len(coco.anns) == 4 and not np.array_equal(*planes)
    for image, plane in zip(coco.imgs.values(), planes, strict=True):
        assert (tmp_path / image["file_name"]).is_file() and image["file_name"].endswith("_after.png")
        assert (image["height"], image["width"]) == plane.shape
        for annotation in coco.loadAnns(coco.getAnnIds(image["id"])):
            inside = plane == annotation["category_id"]
            assert np.array_equal(coco.annToMask(annotation), inside) and annotation["iscrowd"] == 0
            rows, columns = np.nonzero(inside)
            assert annotation["bbox"] == [columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1]
            assert annotation["area"] == inside.sum() > 20


def test_an_evaluation_of_the_truth_by_itself_is_perfect(balls, scene, tmp_path):
    cocoeval = pytest.importorskip("pycocotools.cocoeval")
    coco, _ = annotated(scene, tmp_path)
    detections = coco.loadRes([{**annotation, "score": 1.0} for annotation in coco.anns.values()])
    for kind in ("bbox", "segm"):
        evaluation = cocoeval.COCOeval(coco, detections, kind)
        evaluation.evaluate()
        evaluation.accumulate()
        evaluation.summarize()
        assert evaluation.stats[0] == pytest.approx(1, abs=1e-12)


def test_a_custom_property_is_the_category(balls, scene, tmp_path):
    balls[0]["category_id"], balls[1]["category_id"], balls[2]["category_id"] = 0, 70000, 5
    coco, _ = annotated(scene, tmp_path)
    assert {each["object"]: each["category_id"] for each in coco.anns.values()} == {"B\u00e4ll": 70000, "Background": 5}
    assert {each["name"] for each in coco.cats.values()} == {"5", "70000"}


def test_instances_of_one_name_are_a_crowd(balls, scene, tmp_path):
    collection = bpy.data.collections.new("Balls")
    collection.objects.link(balls[0])
    holder = bpy.data.objects.new("Holder", None)
    holder.instance_type, holder.instance_collection, holder.location = "COLLECTION", collection, (0.1, 0.3, 0)
    scene.collection.objects.link(holder)
    coco, planes = annotated(scene, tmp_path, "--category", "object")
    crowds = {each["object"]: each["iscrowd"] for each in coco.anns.values()}
    assert crowds == {"Near": 1, "B\u00e4ll": 0, "Background": 0}
    near, = (each for each in coco.anns.values() if each["object"] == "Near")
    assert np.array_equal(coco.annToMask(near), planes[0] == 3)
    assert {each["id"]: each["name"] for each in coco.cats.values()} == {1: "Background", 2: "B\u00e4ll", 3: "Near"}


@pytest.mark.parametrize("value", ["chair", 1.5, -1])
def test_a_category_that_is_not_a_number_is_refused_before_the_render(balls, scene, tmp_path, value):
    balls[0]["category_id"] = value
    with refused(SceneError, field="category_id", value=value, where="object 'Near'", match="a whole number"):
        addon.render_through_lens(scene, output_folder=tmp_path, **QUICK)
