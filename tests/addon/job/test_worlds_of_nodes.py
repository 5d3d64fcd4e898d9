"""Worlds that nodes compute: the same picture of the scene as with a flat world, and nothing left by any step."""

from contextlib import ExitStack

import bpy
import numpy as np
import pytest
from mathutils import Vector
from scipy.ndimage import center_of_mass, label

from lensfield.addon import apply_lens
from lensfield.addon.capture import sky
from lensfield.addon.capture.growing_capture import growing_capture
from lensfield.addon.capture.outside_sources import outside_steps
from lensfield.addon.capture.radiance import WholePasses, light_steps
from lensfield.addon.capture.ready import planned_steps, sliced_steps
from lensfield.addon.job.steps import RenderPass
from lensfield.addon.render.render import job_of_frame, render_steps, run
from lensfield.addon.scene.undo import Journal
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.pictures.spectral_exr import read_exr
from lensfield.engine.spectral.wavelength_choice import SpectralOptions
from lensfield.engine.stray.options import StrayOptions
from small_scenes import WAVELENGTHS_NM, background, material, set_world, wall
from snapshot import differences, snapshot
from varied_lenses import varied_lens

PLACES = (-1.5, 0.2), (0.0, 0.0), (1.4, -0.3), (0.1, 0.9), (-0.8, -0.7)  # x and z in m, of lamps 5 m away
LAMP_M, UNIT_M = 0.12, 0.5
SET_BY_WAVELENGTH = "custom.lensfield_"  # the stand-ins' values, which are set before each render


def gradient(scene):
    return {"node": "ShaderNodeTexGradient"}, 0.3


def sky_texture(scene):
    return {"node": "ShaderNodeTexSky"}, 0.02


def environment(scene):
    """Stripes of light, one of them 40 times as bright."""
    image = bpy.data.images.new("Environment", 32, 16, float_buffer=True)
    pixels = np.full((16, 32, 4), 0.5, np.float32)
    pixels[:, ::4, :3] = 0.1, 0.2, 0.4
    pixels[12, 5, :3] = 20.0
    image.pixels.foreach_set(pixels.ravel())
    return {"node": "ShaderNodeTexEnvironment", "image": image}, 0.3


WORLDS = gradient, sky_texture, environment


def set_nodes(scene, world):
    properties, strength = world(scene)
    tree = scene.world.node_tree
    node = tree.nodes.new(properties.pop("node"))
    for name, value in properties.items():
        setattr(node, name, value)
    tree.links.new(node.outputs[0], background(scene).inputs["Color"])
    background(scene).inputs["Strength"].default_value = strength


@pytest.fixture(autouse=True)
def coarse_sky(monkeypatch):
    monkeypatch.setattr(sky, "SIDE_PX", 32)


@pytest.fixture
def lamps(scene):
    """Small lamps in front of a turned camera with a Shift, in a scene whose unit is not a metre; a near one, too."""
    scene.unit_settings.scale_length = UNIT_M
    scene.render.resolution_x, scene.render.resolution_y = 112, 80
    scene.cycles.samples = 4
    scene.render.image_settings.file_format = "OPEN_EXR"  # chooses a colour space, which a factory-new scene lacks
    glow = material("Lamp", "ShaderNodeEmission", (0.9, 0.7, 0.3))[0]
    glow.node_tree.nodes["Emission"].inputs["Strength"].default_value = 9
    scene.camera.location, scene.camera.rotation_euler = (3, -2, 1), (1.2, 0.3, -0.7)
    scene.camera.data.lens, scene.camera.data.shift_x, scene.camera.data.shift_y = 24.0, 0.11, -0.07
    bpy.context.view_layer.update()
    for x, z in PLACES:
        lamp = wall(scene, glow, side_m=LAMP_M / UNIT_M)
        lamp.matrix_world = scene.camera.matrix_world.copy()
        lamp.location = scene.camera.matrix_world @ (Vector((x + 0.5, z - 0.3, -5)) / UNIT_M)
    set_world(scene, (0.2, 0.3, 0.6), 0.2)
    bpy.context.view_layer.update()
    return scene


def given(folder, **others):
    return {"lens": varied_lens("nikkor-28mm"), "view": "camera", "wavelengths_nm": WAVELENGTHS_NM, "denoise": "off",
            "spectral": SpectralOptions("preview"), "output_folder": folder, "depth": "off", "focus": None,
            "stray": StrayOptions("ghosts,veil")} | others


def settings_of(scene):
    """All that a render depends on except the contents of the world: the snapshot of scenes and cameras."""
    return {name: block for name, block in snapshot().items() if name[0] in ("scenes", "cameras")}


def at_same_wavelengths(ready):
    """The snapshot with the stand-ins' values at the first pass's wavelengths: each pass sets them."""
    ready.substitution.set_wavelengths(ready.plan.bands[0], ready.plan.dispersive)
    return snapshot()


def changed(before, after):
    return [line for line in differences(before, after)
            if not any(name in line for name in (SET_BY_WAVELENGTH, ".users", "filepath", "session_uid"))]


def states(steps, look=settings_of):
    """What `look` returns for the scene at each of the renders of some steps, by their labels, and the result."""
    answer, by_label = None, {}
    while True:
        try:
            step = steps.send(answer)
        except StopIteration as end:
            return by_label, end.value
        if step is None:
            return by_label, None
        answer = None
        if isinstance(step, RenderPass):
            by_label[step.label] = look(step.scene)
            bpy.ops.render.render(write_still=True, scene=step.scene.name)
        elif hasattr(step, "call"):
            answer = step.call(lambda fraction: None)


def lamps_at_px(path):
    """Columns and rows of the lamps in an image, from the left."""
    image = read_exr(path).cube.mean(axis=0)
    parts, count = label(image > 0.3 * image.max())
    assert count == len(PLACES)
    return np.array(sorted(center_of_mass(image, parts, range(1, count + 1)), key=lambda place: place[1]))


@pytest.mark.parametrize("world", WORLDS)
def test_the_scene_is_framed_as_with_a_flat_world(lamps, tmp_path, world):
    """And each render has the same settings as with it."""
    at_px, by_label = [], []
    for kind in ("flat", "nodes"):
        if kind == "nodes":
            set_nodes(lamps, world)
        labels, result = states(render_steps(lamps, job_of_frame(lamps, 1, **given(tmp_path / kind))))
        at_px.append([lamps_at_px(path) for path in (result.irradiance, result.radiance)])
        by_label.append(labels)
    np.testing.assert_allclose(at_px[1], at_px[0], rtol=0, atol=0.3)
    flat, nodes = by_label
    assert flat.keys() < nodes.keys() and any(name.startswith("Sky") for name in nodes)
    for name in flat:
        assert not changed(flat[name], nodes[name]), name


@pytest.mark.parametrize("world", WORLDS)
def test_each_step_leaves_the_scene_as_it_was(lamps, tmp_path, world):
    """With slabs of depth: the lens image has a near lamp."""
    near = wall(lamps, bpy.data.materials["Lamp"], side_m=0.04)
    near.matrix_world = lamps.camera.matrix_world.copy()
    near.location = lamps.camera.matrix_world @ Vector((0.03, 0.04, -0.2 / UNIT_M))
    set_nodes(lamps, world)
    job = job_of_frame(lamps, 1, **given(tmp_path, depth="auto"))
    with Journal() as journal, ExitStack() as alone:
        planned = run(planned_steps(lamps, job, (), tmp_path, journal, alone))
        planned_state = at_same_wavelengths(planned)
        with Journal() as of_slabs:
            ready = run(sliced_steps(planned, 1.0, of_slabs))
            assert len(ready.slabs) > 1
            before = at_same_wavelengths(ready)
            run(outside_steps(ready, PixelGrid((80, 112), 100.0, focal_mm=job.lens.capture_focal_length_mm), True))
            assert not changed(before, at_same_wavelengths(ready))
            with Journal() as of_light:
                passes = WholePasses(ready.passes, ready.path, 1)
                run(light_steps(ready, passes, ready.capture_px, ready.slabs, 1.0, of_light))
                assert changed(before, at_same_wavelengths(ready))
            assert not changed(before, at_same_wavelengths(ready))
        assert not changed(planned_state, at_same_wavelengths(planned))


@pytest.mark.parametrize("depth", ["off", "traced"])
def test_a_capture_restores_the_stand_in_camera(lamps, tmp_path, depth):
    """The preview grows its capture; a traced lens has a camera of its own."""
    original = lamps.camera.data
    before = snapshot()
    with Journal() as journal:
        journal.stand_in(original)
        stand_in = settings_of(lamps)
        job = job_of_frame(lamps, 1, **given(tmp_path, depth=depth))
        states(growing_capture(lamps, job) if depth == "off" else render_steps(lamps, job))
        assert not changed(stand_in, settings_of(lamps))
    assert not changed(before, snapshot())


def test_without_stray_light_no_sky_is_rendered(lamps, tmp_path):
    """And a lens that is applied later states that light is missing."""
    set_nodes(lamps, gradient)
    labels, result = states(render_steps(lamps, job_of_frame(lamps, 1, **given(tmp_path, stray=StrayOptions("off")))))
    assert labels and not any(name.startswith("Sky") for name in labels)
    for stray, missing in (("veil", True), ("off", False)):
        applied = apply_lens(result.radiance, lens=varied_lens("nikkor-28mm"), view="camera",
                             stray=StrayOptions(stray), output_folder=tmp_path / stray)
        assert ("beyond the picture is missing" in applied.report.file.lens_warning) == missing


def sampling(scene):
    """How Cycles samples the world, the width of its map, and whether it reads the map anew for each render."""
    cycles = scene.world.cycles
    return cycles.sampling_method, cycles.sample_map_resolution, reads_scene(scene.world.node_tree)


def reads_scene(tree):
    return any(node.bl_idname == "ShaderNodeAttribute" or (
        node.bl_idname == "ShaderNodeGroup" and reads_scene(node.node_tree)) for node in tree.nodes)


@pytest.mark.every_blender
@pytest.mark.parametrize("world, by_light_path, expected", [
    (gradient, False, ("MANUAL", sky.MAP_PX)), (gradient, True, ("AUTOMATIC", 1024)),
    (environment, False, ("MANUAL", sky.SUN_MAP_PX)), (sky_texture, False, ("AUTOMATIC", 1024))])
def test_a_world_gets_a_map_as_small_as_its_light_permits(lamps, tmp_path, world, by_light_path, expected):
    """A small map lets pixels sparkle under a sun. The camera may see another world than surfaces by the light path."""
    set_nodes(lamps, world)
    tree = lamps.world.node_tree
    if by_light_path:
        is_camera_ray = tree.nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"]
        tree.links.new(is_camera_ray, background(lamps).inputs["Strength"])
    steps = render_steps(lamps, job_of_frame(lamps, 1, **given(tmp_path, stray=StrayOptions("off"))))
    by_label, _ = states(steps, sampling)
    passes = {state for name, state in by_label.items() if name.startswith("Pass")}
    assert passes == {(*expected, False)}
    assert lamps.world.cycles.sampling_method == "AUTOMATIC"
