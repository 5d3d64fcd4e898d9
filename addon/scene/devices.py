"""The device that Cycles renders on. In Blender, preferences choose it; the Python module has none."""

from functools import cache

import _cycles
import bpy

from .errors import SceneError

AUTO, CPU = "auto", "cpu"
KINDS = "optix", "cuda", "hip", "metal", "oneapi"
"""Kinds of GPU devices, the one to prefer first: OptiX and CUDA run on the same cards."""
TRACING = CPU, "optix"  # kinds that run camera shaders


def device_of(scene, device, traced=False):
    """The kind of device that renders a scene: CPU, or one of KINDS.

    Parameters
    ----------
    scene : bpy.types.Scene
    device : str
        As in a RenderRequest.
    traced : bool
        Whether Cycles traces a lens: the CPU does, if the requested device cannot.

    Raises
    ------
    SceneError
        This machine does not have the requested device.
    """
    if device == AUTO:
        device = CPU if scene.cycles.device == "CPU" else _preferred()
    elif device != CPU and device not in (present := devices_present()):
        raise SceneError("options", "--device", device,
                         f"this machine has {', '.join([CPU, *present])}: choose one of these, or check the driver")
    return CPU if traced and device not in TRACING else device


@cache
def devices_present():
    """Names of this machine's GPU devices by their kind: dict of str: list of str."""
    names = {kind: [name for name, of, *_ in _cycles.available_devices(kind.upper()) if of == kind.upper()]
             for kind in KINDS}
    return {kind: found for kind, found in names.items() if found}


def device_text(kind):
    """A kind of device, and the names of those that are in use."""
    used = _used(kind)
    return f"{kind.upper()} ({', '.join(used)})" if used else kind.upper()


def use_device(scene, kind, journal):
    """Let Cycles render a scene on a kind of device, and also denoise it there if the scene asks for the other one."""
    preferences = _preferences()
    if kind != CPU and not _used(kind):
        journal.set(preferences, "compute_device_type", kind.upper())
        preferences.refresh_devices()
        for each in preferences.devices:
            if each.type == kind.upper():
                journal.set(each, "use", True)
    device = "CPU" if kind == CPU else "GPU"
    if scene.cycles.device != device:
        journal.set(scene.cycles, "device", device)
        journal.set(scene.cycles, "denoising_use_gpu", kind != CPU)


def _preferences():
    return bpy.context.preferences.addons["cycles"].preferences


def _used(kind):
    """Names of the GPU devices of this kind that the preferences choose."""
    preferences = _preferences()
    return [each.name for each in preferences.devices
            if each.use and each.type == kind.upper() == preferences.compute_device_type]


def _preferred():
    """The kind of device for a scene that asks for a GPU: as in the preferences; in the module, the first one."""
    kind = _preferences().compute_device_type.lower()
    if kind in KINDS:
        return kind if _used(kind) else CPU
    return next(iter(devices_present()), CPU) if bpy.app.module else CPU
