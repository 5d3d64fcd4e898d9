"""The graphics processor: found and opened when it is first used, and used by a single thread."""

import os
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import lru_cache
from threading import Lock
from typing import Any, TypeVar

from ..runtime.errors import shown

GPU = "gpu"
VARIABLE = "LENSFIELD_KERNELS"
BACKENDS = ("Vulkan", "Metal", "DX12")  # OpenGL would have to be used by the thread that started it
KINDS = ("DiscreteGPU", "IntegratedGPU", "CPU", "Unknown")  # of adapters, the best first
REAL = KINDS[:2]
MESAS_LAYER = "NODEVICE_SELECT"  # the variable that disables it
LIMITS = ("max-buffer-size", "max-storage-buffer-binding-size")
LONGEST_REASON = 200  # characters of a driver's message
FIRST_RATE = 4e8  # look-ups in a second; slow graphics processors do about as many
CALL_S = 0.05  # of a call: systems stop graphics processors that do not respond for two seconds, and screens freeze
FASTER = 4.0  # the largest factor on the work from a call to the next one

PROCESS = os.getpid()  # forked processes cannot use its connection to a driver

Result = TypeVar("Result")
_searching = Lock()
_problems: list[str] = []


class Gpu:
    """An opened graphics processor.

    Attributes
    ----------
    name : str
        With its interface and driver.
    device : wgpu.GPUDevice
        Only for functions that `call` runs.
    limit_bytes : int
        Largest size of a buffer.
    rate : float
        Look-ups in a second, as last measured.
    pipelines : dict
        Compiled loops.
    works : bool
        False after an error.
    """

    def __init__(self, adapter: Any):
        self.name = _name(adapter)
        limits = {name: adapter.limits[name] for name in LIMITS}
        self.device = self.call(lambda: adapter.request_device_sync(required_limits=limits))
        self.limit_bytes = min(limits.values())
        self.rate = FIRST_RATE
        self.pipelines: dict[Any, Any] = {}
        self.works = True

    def call(self, function: Callable[..., Result], *arguments: Any) -> Result:
        """The result of a function that the thread of the graphics processor calls."""
        return _thread().submit(function, *arguments).result()

    @property
    def look_ups_of_call(self) -> float:
        """The work of a call that takes about CALL_S."""
        return CALL_S * self.rate

    def learn_rate(self, look_ups: float, seconds: float) -> None:
        """Adapt the work of the next call; a short call for little work shows only that the processor is not slower."""
        rate = look_ups / seconds
        if rate > self.rate or seconds > CALL_S:
            self.rate = min(rate, FASTER * self.rate)

    def warn(self, problem: Exception) -> None:
        """Warn in one line that C is used because of an error, once for each, and keep the line for reports."""
        _warn(self.name, problem)

    def give_up(self, problem: Exception) -> None:
        """Do not use it again in this process."""
        self.works = False
        self.warn(problem)


def usable_gpu() -> Gpu | None:
    """The graphics processor that casts and spreads, or None if C or numpy does.

    LENSFIELD_KERNELS=gpu accepts any adapter, also one that the processor emulates. Other values name other loops.
    Without the variable, real graphics processors are accepted.
    """
    requested = os.environ.get(VARIABLE) or None
    if requested not in (None, GPU) or os.getpid() != PROCESS:
        return None
    with _searching:
        gpu = _opened(requested == GPU)
    return gpu if gpu and gpu.works else None


def adapters() -> list:
    """This machine's graphics adapters, the best first."""
    return _found()[0]


def problems() -> tuple[str, ...]:
    """Why a graphics processor of this process is not used, or has left something to C, one line each."""
    return tuple(_problems)


def missing() -> str:
    """What LENSFIELD_KERNELS=gpu lacks on this machine; "" for nothing."""
    return _found()[1]


@lru_cache
def _opened(any_kind):
    """The best adapter, opened; None without one."""
    usable = [each for each in adapters() if any_kind or each.info["adapter_type"] in REAL]
    if not usable:
        return None
    try:
        return Gpu(usable[0])
    except Exception as problem:  # drivers fail in many ways
        _warn(_name(usable[0]), problem)
        return None


@lru_cache
def _found():
    """This machine's adapters, the best first; and why there are none."""
    try:
        found = _thread().submit(_search).result()
    except ImportError:
        return [], "the Python package wgpu is not installed"
    except Exception as problem:  # as of a library for another system
        return [], f"the Python package wgpu fails: {_reason(problem)}"
    return found, "" if found else "this machine has no graphics adapter for Vulkan, Metal or Direct3D 12"


def _search():
    import wgpu
    from wgpu.backends.wgpu_native.extras import set_instance_extras

    with _without_mesas_layer():
        with suppress(RuntimeError):  # another add-on has started wgpu
            set_instance_extras(backends=BACKENDS)
        found = [each for each in wgpu.gpu.enumerate_adapters_sync() if each.info["backend_type"] != "OpenGL"]
    return sorted(found, key=lambda each: (KINDS.index(each.info["adapter_type"]),
                                           each.info["backend_type"] != "Vulkan"))


@contextmanager
def _without_mesas_layer():
    """Leave out a layer of Mesa's that sorts adapters, and prints errors on a machine without a display."""
    before = os.environ.get(MESAS_LAYER)
    os.environ[MESAS_LAYER] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[MESAS_LAYER]
        else:
            os.environ[MESAS_LAYER] = before


@lru_cache
def _thread():
    return ThreadPoolExecutor(1, "Lensfield GPU")


def _name(adapter):
    return ", ".join(filter(None, (adapter.info[each] for each in ("device", "backend_type", "description"))))


def _reason(problem):
    return shown(str(problem).strip() or type(problem).__name__, LONGEST_REASON)


def _warn(name, problem):
    """Warn in one line, without a line of code, unless this was done before."""
    text = f"{_reason(problem)}: C is used instead"
    if f"{name}: {text}" not in _problems:
        _problems.append(f"{name}: {text}")
        warnings.warn_explicit(text, RuntimeWarning, name, 0)
