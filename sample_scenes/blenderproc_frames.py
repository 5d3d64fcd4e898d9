# Render 20 frames through a lens by BlenderProc, with annotations in the layout of COCO.
#
#     blenderproc run sample_scenes/blenderproc_frames.py DIR [--lens NAME] [--frames N]
#
# writes DIR/images and DIR/coco_annotations.json; and DIR/scene.blend, which `lensfield render` takes through the lens
# with blur, falloff and spectra. docs/blenderproc.md shows both.
import blenderproc as bproc  # noqa: I001, BlenderProc requires it to be the first

import argparse
from pathlib import Path

import bpy
import numpy as np

from lensfield import Rings
from lensfield.blenderproc import set_lens_distortion

SIZE_PX = 320, 240
FOCUS_M, F_NUMBER, SAMPLES = 2.0, 4.0, 32
SHAPES = {"CUBE": "cube", "SPHERE": "ball", "MONKEY": "monkey"}
CATEGORIES = {"background": 0, "cube": 1, "ball": 2, "monkey": 3}
THINGS, SEED = 18, 7


def add_things(random):
    """A floor, and things of three categories on it, each with a colour of its own."""
    floor = bproc.object.create_primitive("PLANE")
    floor.set_scale([20, 20, 1])
    floor.set_cp("category_id", CATEGORIES["background"])
    floor.new_material("Floor").set_principled_shader_value("Base Color", [0.4, 0.4, 0.4, 1])
    for number in range(THINGS):
        kind = list(SHAPES)[number % len(SHAPES)]
        thing = bproc.object.create_primitive(kind)
        place = 0.32 * np.array([number % 6 - 2.5, number // 6 - 1.0])
        thing.set_name(f"{SHAPES[kind]} {number}")
        thing.set_scale(3 * [random.uniform(0.07, 0.12)])
        thing.set_location([*(place + random.uniform(-0.04, 0.04, 2)), 0.12])
        thing.set_rotation_euler([0, 0, random.uniform(0, 2 * np.pi)])
        thing.set_cp("category_id", CATEGORIES[SHAPES[kind]])
        colour = [*random.uniform(0.1, 0.9, 3), 1]
        thing.new_material(thing.get_name()).set_principled_shader_value("Base Color", colour)


def add_light():
    lamp = bproc.types.Light("AREA", name="Lamp")
    lamp.set_location([1.5, -1.5, 3])
    lamp.set_rotation_mat(bproc.camera.rotation_from_forward_vec([-1.5, 1.5, -3]))
    lamp.set_energy(120)


def add_cameras(frames):
    """Camera poses on a quarter of a circle around the things, which they look at."""
    for angle in np.linspace(0, np.pi / 2, frames):
        place = np.array([1.6 * np.sin(angle), -1.6 * np.cos(angle), 0.9])
        turn = bproc.camera.rotation_from_forward_vec(np.array([0, 0, 0.05]) - place)
        bproc.camera.add_camera_pose(bproc.math.build_transformation_mat(place, turn))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("output", type=Path, metavar="DIR")
    parser.add_argument("--lens", default="nikkor-28mm")
    parser.add_argument("--frames", type=int, default=20)
    options = parser.parse_args()

    bproc.init()
    add_things(np.random.default_rng(SEED))
    add_light()
    add_cameras(options.frames)
    bproc.camera.set_resolution(*SIZE_PX)
    options.output.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str((options.output / "scene.blend").resolve()))

    mapping_coords = set_lens_distortion(options.lens, Rings(focus_mm=1000 * FOCUS_M, f_number=F_NUMBER))
    bproc.renderer.set_max_amount_of_samples(SAMPLES)
    bproc.renderer.enable_segmentation_output(map_by=["category_id", "instance", "name"])
    data = bproc.renderer.render()

    def through_lens(pictures, **how):
        return bproc.postprocessing.apply_lens_distortion(pictures, mapping_coords, *SIZE_PX, **how)

    bproc.writer.write_coco_annotations(
        str(options.output), through_lens(data["instance_segmaps"], use_interpolation=False),
        data["instance_attribute_maps"], through_lens(data["colors"]), append_to_existing_output=False,
        label_mapping=bproc.utility.LabelIdMapping.from_dict(CATEGORIES))


main()
