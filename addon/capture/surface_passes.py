"""Blender's passes of the surfaces in a capture, with few samples and without bounces."""

from ..job.steps import RenderPass
from ..scene.render_state import read_again, rendered_layer, show_samples, show_slab
from ..scene.undo import Journal
from ..scene.volumes import hide_volumes
from .slabs import LOOK


def surface_planes_steps(ready, slab, passes, samples, fraction, *, times=1, motion_blur=False):
    """Steps that render some of Blender's passes of a slab, without volumes; returns their planes by channel.

    Parameters
    ----------
    ready : Ready
    slab : Slab
    passes : mapping of str to str
        From the names of their settings to their channels, such as Normal.XYZ or CryptoObject.
    samples : int
    fraction : float
        Of the job so far.
    times : int
        Parts of a pixel, down and across, to render instead of it.
    motion_blur : bool
        Whether to render the scene's motion blur. With it, Cycles does not write motion.
    """
    scene, layer = ready.scene, rendered_layer(ready.scene)
    with Journal() as journal:
        hide_volumes(scene, journal)
        journal.set(scene.render, "use_motion_blur", motion_blur and scene.render.use_motion_blur)
        journal.set(layer, "samples", 0)  # no override of the scene's samples
        for name, value in (LOOK | {"samples": samples}).items():
            journal.set(scene.cycles, name, value)
        for name in passes:
            journal.set(layer, f"use_pass_{name}", True)
        if any(name.startswith("cryptomatte") for name in passes):
            journal.set(scene.render, "use_persistent_data", False)  # with it, Cycles damages memory in a later render
        show_slab(scene, slab.finer(times), ready.capture_px.finer(times), journal)
        show_samples(scene, 0, samples, False, journal)
        channels = {f"{layer.name}.{channel}": channel
                    for name in passes.values() for channel in _channels(name, layer.pass_cryptomatte_depth)}
        planes = yield from ready.passes.planes(RenderPass(scene, "Rendering ground truth", fraction, 0.0), ready.path,
                                                channels, "ground truth", *sorted(passes), samples, times, motion_blur,
                                                *slab.facts)
    read_again(scene)
    return {channel: planes[name] for name, channel in channels.items()}


def _channels(name, levels):
    """The channels of a pass."""
    if "." not in name:  # of Cryptomatte, with two levels in each
        return [f"{name}{number:02}.{channel}" for number in range(-(-levels // 2)) for channel in "rgba"]
    name, channels = name.split(".")
    return [f"{name}.{channel}" for channel in channels]
