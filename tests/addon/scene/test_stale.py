"""A lens image of an older scene is never shown as current: it is compared as a render begins, on any thread."""

import threading

import bpy
import numpy as np
import pytest

from laid_images import lay, shows_lens_image
from lensfield.addon.scene import compositor, compositor_watch
from lensfield.addon.scene.compositor import compositor_state, fingerprint_anew
from lensfield.addon.scene.fingerprint import forget_all
from small_scenes import background, material, set_world, wall

CHANGED = "plain render, the scene has changed since"


def image_of(name, colour, path=None):
    image = bpy.data.images.new(name, 8, 4, float_buffer=False)
    paint(image, colour)
    if path:
        image.filepath_raw, image.file_format = str(path), "PNG"
        image.save()
    return image


def paint(image, colour):
    image.pixels.foreach_set(np.tile(np.float32([*colour, 1]), image.size[0] * image.size[1]))


@pytest.fixture
def furnished(scene, tmp_path):
    """A lens image of a scene with many kinds of data, under a black sky.

    The scene has a wall, a lamp, a text object, a painted, a packed and a saved image, and geometry nodes.
    """
    paint_material, shader = material("Paint", "ShaderNodeBsdfDiffuse")
    tree = paint_material.node_tree
    wall(scene, paint_material).location.z = -50.0
    for name, path in (("Painted", None), ("Packed", None), ("Saved", tmp_path / "saved.png")):
        node = tree.nodes.new("ShaderNodeTexImage")
        node.name, node.image = name, image_of(name, (0.2, 0.4, 0.6), path)
    bpy.data.images["Packed"].pack()
    for kind, data in (("Lamp", bpy.data.lights.new("Lamp", "POINT")), ("Sign", bpy.data.curves.new("Sign", "FONT"))):
        obj = bpy.data.objects.new(kind, data)
        obj.location.z = 50.0
        scene.collection.objects.link(obj)
    nodes = bpy.data.node_groups.new("Grow", "GeometryNodeTree")
    nodes.nodes.new("GeometryNodeTransform").name = "Transform"
    scene.objects["Wall"].modifiers.new("Grow", "NODES").node_group = nodes
    scene.objects["Wall"].hide_render = True  # the plain render is black, and the lens image is not
    lay(scene, tmp_path)
    bpy.context.view_layer.update()
    return scene


def paint_and_save(image, colour):
    paint(image, colour)
    image.save()


def repack(image, colour):
    paint(image, colour)
    image.pack()


def shader_value(scene, value):
    next(node for node in bpy.data.materials["Paint"].node_tree.nodes
         if node.bl_idname == "ShaderNodeBsdfDiffuse").inputs["Roughness"].default_value = value


def move_vertex(scene, x):
    vertices = scene.objects["Wall"].data.vertices
    places = np.empty(3 * len(vertices), np.float32)
    vertices.foreach_get("co", places)
    places[0] = x
    vertices.foreach_set("co", places)  # Blender sends no update for this


EDITS = {  # name: (function of the scene and a value, the current value, another)
    "object moved": (lambda scene, x: setattr(scene.objects["Lamp"].location, "x", x), 0.0, 1.0),
    "camera turned": (lambda scene, x: setattr(scene.camera.rotation_euler, "y", x), 0.0, 0.1),
    "material node": (shader_value, 0.0, 0.5),
    "lamp": (lambda scene, watts: setattr(bpy.data.lights["Lamp"], "energy", watts), 10.0, 20.0),
    "world": (lambda scene, red: setattr(background(scene).inputs["Color"], "default_value", (red, 0, 0, 1)), 0.0, 0.1),
    "vertex": (move_vertex, -5.0, -4.0),
    "sign": (lambda scene, body: setattr(bpy.data.curves["Sign"], "body", body), "Text", "Other"),
    "geometry node": (lambda scene, scale: setattr(bpy.data.node_groups["Grow"].nodes["Transform"].inputs["Scale"],
                                                   "default_value", (scale, 1, 1)), 1.0, 2.0),
    "painted image": (lambda scene, red: paint(bpy.data.images["Painted"], (red, 0.4, 0.6)), 0.2, 0.9),
    "packed image": (lambda scene, red: repack(bpy.data.images["Packed"], (red, 0.4, 0.6)), 0.2, 0.9),
    "saved image": (lambda scene, red: paint_and_save(bpy.data.images["Saved"], (red, 0.4, 0.6)), 0.2, 0.9),
    "unit scale": (lambda scene, scale: setattr(scene.unit_settings, "scale_length", scale), 1.0, 0.1),
    "samples": (lambda scene, samples: setattr(scene.cycles, "samples", samples), 16, 17)}


def switches_on(scene):
    """Whether the keyframes, which alone count in a render, show the lens image at frame 1."""
    group = compositor._node(scene).node_tree
    return compositor._keys(group)["Image"][1]


def on_another_thread(scene):
    """Simulates the start of a render by F12 in a window."""
    thread = threading.Thread(target=compositor_watch.on_frame_render, args=(scene,))
    thread.start()
    thread.join()


def by_script(scene):
    """Simulates the start of a render by a script."""
    compositor_watch.on_render(scene)


@pytest.mark.parametrize("begin", [by_script, on_another_thread])
@pytest.mark.parametrize("name", EDITS)
def test_an_edit_and_its_undo_are_detected_when_a_render_starts(furnished, name, begin):
    edit, before, other = EDITS[name]
    begin(furnished)
    assert switches_on(furnished) and compositor_state(furnished)[0] == "lens image"
    if begin is on_another_thread:
        forget_all()  # Blender's updates during a render may do this
    edit(furnished, other)
    if begin is on_another_thread:
        bpy.context.view_layer.update()  # sends the window the update for the edit
    begin(furnished)
    assert not switches_on(furnished) and compositor_state(furnished)[0] == CHANGED
    edit(furnished, before)
    if begin is on_another_thread:
        bpy.context.view_layer.update()
    begin(furnished)
    assert switches_on(furnished) and compositor_state(furnished)[0] == "lens image"


@pytest.mark.parametrize("on_main_thread", [True, False])
def test_consecutive_renders_detect_an_edit_and_its_undo(furnished, tmp_path, monkeypatch, on_main_thread):
    """Renders of frames 1 and 2, where 1 has a lens image; F12 compares on the render thread."""
    monkeypatch.setattr(compositor_watch, "in_main_thread", lambda: on_main_thread)
    assert shows_lens_image(furnished, tmp_path) and not shows_lens_image(furnished, tmp_path, 2)
    furnished.objects["Lamp"].location.x = 3.0
    assert not shows_lens_image(furnished, tmp_path)
    assert compositor_state(furnished)[0] == CHANGED
    furnished.objects["Lamp"].location.x = 0.0
    assert shows_lens_image(furnished, tmp_path)
    assert compositor_state(furnished)[0] == "lens image"


@pytest.mark.parametrize("begin", [by_script, on_another_thread])
def test_data_added_since_the_render_counts(furnished, begin):
    begin(furnished)
    new = bpy.data.objects.new("New", bpy.data.meshes.new("New"))
    furnished.collection.objects.link(new)
    begin(furnished)
    assert not switches_on(furnished)
    lay(furnished, compositor_folder(furnished))
    begin(furnished)
    assert switches_on(furnished)
    new.location.x = 1.0
    bpy.context.view_layer.update()
    begin(furnished)
    assert not switches_on(furnished)


def compositor_folder(scene):
    return compositor.Path(compositor.picture_folder(scene))


def test_data_forgotten_during_a_render_counts_as_changed(furnished):
    """As a window is notified: not immediately, because other data-blocks change all the time, but at the next check.
    """
    fingerprint_anew(furnished)
    forget_all()
    furnished.objects["Lamp"].location.x = 2.0
    bpy.context.view_layer.update()
    compositor_watch.check()
    compositor_watch._last["update_s"] -= 1
    compositor_watch.check()
    assert compositor_state(furnished)[0] == CHANGED


def test_keyframes_overwritten_on_a_thread_are_announced_later(furnished):
    forget_all()
    furnished.objects["Lamp"].location.x = 2.0
    on_another_thread(furnished)
    group = compositor._node(furnished).node_tree
    assert group.session_uid in compositor._rewritten
    compositor.refresh(furnished)
    assert group.session_uid not in compositor._rewritten and not switches_on(furnished)


def test_a_file_counts_by_its_contents_not_its_modification_time(furnished, tmp_path):
    before = fingerprint_anew(furnished)
    path = tmp_path / "saved.png"
    path.write_bytes(path.read_bytes())
    assert fingerprint_anew(furnished) == before
    path.write_bytes(path.read_bytes() + b"\0")
    assert fingerprint_anew(furnished) != before


@pytest.mark.parametrize("path", ["/dev/zero", "\\\\elsewhere\\share\\picture.png", "//elsewhere/share.png", "\0"])
def test_devices_and_network_paths_are_not_read(furnished, path):
    bpy.data.images["Saved"].filepath_raw = path.replace("\0", "")
    assert fingerprint_anew(furnished) == fingerprint_anew(furnished)
    set_world(furnished, (0, 0, 0))
