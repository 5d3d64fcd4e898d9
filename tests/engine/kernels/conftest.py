"""The graphics processor for tests: any adapter, also Mesa's emulation, which .ci/run installs."""

import pytest

from lensfield.engine.kernels import gpu as gpu_module
from lensfield.engine.kernels import spread_picture as spread_picture_module
from lensfield.engine.kernels.gpu import GPU, VARIABLE, missing, usable_gpu


@pytest.fixture
def gpu(monkeypatch):
    """The graphics processor, in use for any amount of work, and without a record of failures during a test."""
    if lacking := missing():
        pytest.skip(f"{lacking}: install wgpu, and mesa-vulkan-drivers for an emulation")
    monkeypatch.setenv(VARIABLE, GPU)
    gpu = usable_gpu()
    monkeypatch.setattr(gpu, "works", True)
    monkeypatch.setattr(gpu, "rate", gpu.rate)
    monkeypatch.setattr(gpu_module, "_problems", [])
    for name in ("LEAST_TAPS", "TAPS_PER_BYTE"):
        monkeypatch.setattr(spread_picture_module, name, 0)
    return gpu


@pytest.fixture
def searched_again():
    """Forget the adapters before and after a test."""
    gpu_module._found.cache_clear()
    gpu_module._opened.cache_clear()
    yield
    gpu_module._found.cache_clear()
    gpu_module._opened.cache_clear()
