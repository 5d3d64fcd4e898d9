"""Blender through its Python wheel: one registered add-on, and an empty scene for each test."""

import os
import shutil

import bpy
import pytest
from bpy.app.handlers import persistent

from lensfield import addon
from lensfield.addon.render import one_capture
from lensfield.addon.scene import depth
from lensfield.addon.ui.preview import focus_overlay, state
from lensfield.engine.runtime import child
from seed import FIRST_CYCLES_SEED
from waiting import LAST_RESORT_S

OF_THE_API = {"scene", "shading", "ui"}
"""Folders whose tests run on every Blender of CI, unless marked `one_blender`: elsewhere, only `every_blender` does."""

seeds_rendered = []


def pytest_itemcollected(item):
    if item.path.parent.name not in OF_THE_API and not item.get_closest_marker("every_blender"):
        item.add_marker("one_blender")


@pytest.fixture(scope="session", autouse=True)
def registered_addon():
    addon.register()
    bpy.app.handlers.load_post.append(shift_seeds)
    bpy.app.handlers.render_init.append(note_seed)


@pytest.fixture(scope="session", autouse=True)
def patient_addon():
    """Remove the time limits that protect an artist from waiting, because on a slow machine they change the results."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(child, "GRACE_S", LAST_RESORT_S)
        patch.setattr(depth, "LONGEST_S", LAST_RESORT_S)
        patch.setattr(focus_overlay, "LONGEST_S", LAST_RESORT_S)
        patch.setattr(state, "LONGEST_COPY_S", LAST_RESORT_S)
        yield


@persistent
def shift_seeds(*_):
    """Give scenes from files or from the factory settings other seeds, unless a test has saved them with shifted seeds.
    """
    for scene in bpy.data.scenes:
        if scene.cycles.seed < FIRST_CYCLES_SEED:
            scene.cycles.seed += FIRST_CYCLES_SEED


@persistent
def note_seed(scene, *_):
    seeds_rendered.append(scene.cycles.seed)


@pytest.fixture(autouse=True)
def all_seeds_are_shifted():
    yield
    unshifted = [seed for seed in seeds_rendered if seed < FIRST_CYCLES_SEED]
    seeds_rendered.clear()  # before the verdict: a failure must not repeat in later tests
    assert not unshifted, f"rendered with seeds below {FIRST_CYCLES_SEED}"


def pytest_unconfigure(config):
    """Exit with pytest's own status: some wheels crash while the interpreter exits."""
    shutil.rmtree(bpy.app.tempdir, ignore_errors=True)
    os._exit(int(config.stash.get(_EXIT_STATUS, 1)))


def pytest_sessionfinish(session, exitstatus):
    session.config.stash[_EXIT_STATUS] = exitstatus


_EXIT_STATUS = pytest.StashKey()


@pytest.fixture
def scene():
    """An empty scene of 48 x 36 px, 16 samples, with a camera at the origin that looks along -z, and a black world.

    Its lens image has three wavelengths, and no stray light, which takes half of the time of a small render.
    """
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)  # without preferences, which no test changes
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = 16
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.sample_clamp_indirect = 0
    scene.cycles.sampling_pattern = "TABULATED_SOBOL"  # independent noise in each pixel, as noise.py requires
    scene.cycles.max_bounces = 2
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 48, 36, 100
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.clip_start = 0.001
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.lensfield.stray_light, scene.lensfield.wavelength_count = "OFF", 3
    scene.world = world = bpy.data.worlds.new("World")
    world.use_nodes = True
    background = next(node for node in world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")
    background.inputs["Color"].default_value = (0, 0, 0, 1)
    return scene


@pytest.fixture
def captures(monkeypatch):
    """A list of the frames for which `OneCapture` creates a capture."""
    frames, capture = [], one_capture.capture

    def counted(scene, job, *arguments):
        frames.append(job.frame)
        return (yield from capture(scene, job, *arguments))

    monkeypatch.setattr(one_capture, "capture", counted)
    return frames


@pytest.fixture
def saved(scene, tmp_path):
    """A scene of a saved .blend, in a folder of its own."""
    (tmp_path / "film").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "film" / "scene.blend"))
    return bpy.context.scene
