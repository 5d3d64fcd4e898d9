"""A scene with every setting of Lensfield other than its default, for golden .blend files."""

import os
from pathlib import Path

import bpy

from lensfield.addon.ui.common.properties import _OWNERS

NOT_STORED = "auto_iso", "auto_shutter"  # computed from others
CHOSEN = {"lens": "nikkor-28mm", "body": "nikon-d850", "lens_file": "//lens.npz", "body_file": "//camera.toml",
          "output_folder": "//renders/", "wavelength_list": "440, 550, 660", "view_layer": "View",
          "compositor_key": "golden", "reflectance": "leaf-maple", "refraction": "gold",
          "emission": "400:0.1, 700:0.2"}
"""Texts, and enumerations whose items are the library's."""


def fill():
    """Give an empty scene a camera, a light, a world and a material, with settings that differ from their defaults;
    returns the scene."""
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    for thing in (scene.camera, lamp):
        scene.collection.objects.link(thing)
    bpy.data.materials.new("Material").use_fake_user = True
    for _, name, _, settings in _settings(scene):
        setattr(settings, name, _other(settings, name))
    return scene


def facts_of_scene(scene):
    """The settings of Lensfield in a scene from `fill`: dict of numbers and texts."""
    return {f"{owner}.{name}": _plain(getattr(settings, name)) for owner, name, _, settings in _settings(scene)}


def write_preset(folder):
    """Write a preset of the active camera's lens and body, without their files' complete paths; returns its path."""
    os.environ["BLENDER_USER_SCRIPTS"] = str(Path(folder, "scripts"))
    settings = bpy.context.scene.camera.data.lensfield
    settings.lens_file = settings.body_file = ""
    bpy.ops.lensfield.add_camera_preset(name="golden")
    return Path(folder, "scripts", "presets", "lensfield", "camera", "golden.py")


def _settings(scene):
    """(owner, name, property, settings) of each stored setting."""
    owners = {"Scene": scene, "Camera": scene.camera.data, "Material": bpy.data.materials["Material"],
              "Light": bpy.data.lights["Lamp"], "World": scene.world}
    for kind, group in _OWNERS:
        for name, each in sorted(group.__annotations__.items()):
            if name not in NOT_STORED:
                yield kind.__name__, name, each, owners[kind.__name__].lensfield


def _other(settings, name):
    """A valid value of a property that is not its default."""
    rna = settings.bl_rna.properties[name]
    if name in CHOSEN:
        return CHOSEN[name]
    if rna.type == "BOOLEAN":
        return not rna.default
    if rna.type == "ENUM":
        names = [item.identifier for item in rna.enum_items]
        return set(names[:2]) if rna.is_enum_flag else names[-1] if names[-1] != rna.default else names[0]
    if getattr(rna, "is_array", False):
        return [value + 0.125 for value in rna.default_array]
    return rna.default + 1 if rna.type == "INT" else min(rna.default + 0.125, rna.hard_max)


def _plain(value):
    if isinstance(value, set):
        return sorted(value)
    if isinstance(value, float):
        return round(value, 6)
    return [*map(_plain, value)] if hasattr(value, "__len__") and not isinstance(value, str) else value
