"""Blender through its Python wheel: one registered add-on, and an empty scene for each test."""

import os
import shutil

import bpy
import pytest
from bpy.app.handlers import persistent

from lensfield import addon

FIRST_SEED = 1000 * int(os.environ.get("SEED", 0))  # `make test SEED=n`; tests take some seeds beyond the scene's own
seeds_rendered = []


@pytest.fixture(scope="session", autouse=True)
def registered_addon():
    addon.register()
    bpy.app.handlers.load_post.append(shift_seeds)
    bpy.app.handlers.render_init.append(note_seed)


@persistent
def shift_seeds(*_):
    """Give the scenes of a file, or those from the factory, other seeds, unless a test has saved them with such."""
    for scene in bpy.data.scenes:
        if scene.cycles.seed < FIRST_SEED:
            scene.cycles.seed += FIRST_SEED


@persistent
def note_seed(scene, *_):
    seeds_rendered.append(scene.cycles.seed)


@pytest.fixture(autouse=True)
def all_seeds_are_shifted():
    yield
    assert all(seed >= FIRST_SEED for seed in seeds_rendered)
    seeds_rendered.clear()


def pytest_unconfigure(config):
    """End with pytest's own verdict: some wheels crash while the interpreter exits."""
    shutil.rmtree(bpy.app.tempdir, ignore_errors=True)
    os._exit(int(config.stash.get(_EXIT_STATUS, 1)))


def pytest_sessionfinish(session, exitstatus):
    session.config.stash[_EXIT_STATUS] = exitstatus


_EXIT_STATUS = pytest.StashKey()


@pytest.fixture
def scene():
    """An empty scene of 48 x 36 px, 16 samples, with a camera at the origin that looks along -z, and a black world."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)  # and no preferences, which no test changes
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = 16
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.sample_clamp_indirect = 0
    scene.cycles.sampling_pattern = "TABULATED_SOBOL"  # the noise of each pixel is its own, as noise.py has it
    scene.cycles.max_bounces = 2
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 48, 36, 100
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.clip_start = 0.001
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.world = world = bpy.data.worlds.new("World")
    world.use_nodes = True
    background = next(node for node in world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")
    background.inputs["Color"].default_value = (0, 0, 0, 1)
    return scene
