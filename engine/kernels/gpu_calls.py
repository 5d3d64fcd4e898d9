"""Calls of compiled loops on a graphics processor: its buffers, its shaders, and their comparison with C."""

import time
import weakref
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from .gpu import Gpu

UNIFORMS, CALL = range(2)  # bindings of all loops: numbers of the work, and of a call
CALL_BYTES = 20
PIECE_BYTES = 1 << 25  # of an upload: the library copies a piece, and frees the copy after it
CACHE_BYTES = 1 << 31  # of a graphics processor's memory, in buffers for the next pictures
AGREEMENT = 1e-3  # largest difference from C in a sample, relative to the brightest
MOST_LOOPS = 50_000  # of an invocation: Mesa's emulation silently ends it after 65,535


class TooLarge(MemoryError):
    """Work does not fit into the graphics processor."""


class Disagreement(Exception):
    """Results differ from C by more than rounding: the driver miscompiles the shader."""


def check_agreement(by_gpu: Iterable[np.ndarray], by_c: Iterable[np.ndarray]) -> None:
    """Raise Disagreement if pictures of a sample differ from those of C."""
    for one, other in zip(by_gpu, by_c, strict=True):
        if not np.abs(one - other).max() <= AGREEMENT * np.abs(other).max():
            raise Disagreement("works on a small sample differently from C, so its driver compiles shaders wrongly")


def compiled(gpu: Gpu, source: str, names: Iterable[str], **constants: int | bool) -> list[Any]:
    """The pipelines of functions of a source file, after lines with constants."""
    lines = "".join(f"const {name} = {str(value).lower() if isinstance(value, bool) else f'{value}u'};\n"
                    for name, value in constants.items())
    code = Path(__file__).with_name(source).read_text(encoding="utf-8")
    module = gpu.device.create_shader_module(code=lines + code)
    return [gpu.device.create_compute_pipeline(layout="auto", compute={"module": module, "entry_point": name})
            for name in names]


def bound(gpu: Gpu, pipeline: Any, resources: Mapping[int, dict[str, Any]]) -> Any:
    """Buffers of a pipeline, or parts of these, by their bindings."""
    return gpu.device.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=[
        {"binding": binding, "resource": resource} for binding, resource in resources.items()])


def submit(gpu: Gpu, passes: Iterable[tuple[Any, Any, tuple[int, ...]]]) -> None:
    """Run passes one after the other: pipelines, their buffers, and the number of workgroups along each axis."""
    encoder = gpu.device.create_command_encoder()
    step = encoder.begin_compute_pass()
    for pipeline, buffers, groups in passes:
        step.set_pipeline(pipeline)
        step.set_bind_group(0, buffers)
        step.dispatch_workgroups(*groups)
    step.end()
    gpu.device.queue.submit([encoder.finish()])


class Buffers:
    """Buffers by their bindings, in addition to those of others, until they are closed.

    Only for functions that `Gpu.call` runs.
    """

    def __init__(self, gpu: Gpu, others: "Buffers | None" = None) -> None:
        self._gpu, self._others = gpu, others
        self._buffers: dict[int, Any] = {}

    def __getitem__(self, binding: int) -> Any:
        if binding in self._buffers or self._others is None:
            return self._buffers[binding]
        return self._others[binding]

    @property
    def nbytes(self) -> int:
        """Size of its own buffers."""
        return sum(buffer.size for buffer in self._buffers.values())

    def make(self, binding: int, size: int, usage: str = "STORAGE") -> None:
        """A buffer of a number of bytes, which are 0."""
        if size > self._gpu.limit_bytes:
            raise TooLarge(f"cannot hold a table of {size / 1e6:.0f} MB, above its limit of "
                           f"{self._gpu.limit_bytes / 1e6:.0f} MB")
        self._buffers[binding] = self._gpu.device.create_buffer(size=max(4, size), usage=f"{usage}|COPY_SRC|COPY_DST")

    def put(self, binding: int, *arrays: np.ndarray, usage: str = "STORAGE") -> None:
        """A buffer with the contents of arrays, one after the other."""
        arrays = tuple(np.ascontiguousarray(array) for array in arrays)
        self.make(binding, sum(array.nbytes for array in arrays), usage)
        begin, queue = 0, self._gpu.device.queue
        for array in arrays:
            for at in range(0, array.nbytes, PIECE_BYTES):
                size = min(PIECE_BYTES, array.nbytes - at)
                queue.write_buffer(self[binding], begin + at, array, at, size)
                queue.submit([])
            begin += array.nbytes

    def bound(self, pipeline: Any, bindings: Iterable[int]) -> Any:
        """The buffers of a pipeline."""
        return bound(self._gpu, pipeline, {binding: {"buffer": self[binding]} for binding in bindings})

    def run(self, pipeline: Any, bound: Any, groups: tuple[int, ...], call: tuple[int, ...],
            look_ups: float = 0.0) -> None:
        """Run workgroups. For a number of look-ups, wait for them: their seconds set the size of later calls."""
        started = time.perf_counter()
        self._gpu.device.queue.write_buffer(self[CALL], 0, np.array(call, np.uint32))
        submit(self._gpu, [(pipeline, bound, groups)])
        if look_ups:
            self.wait()
            self._gpu.learn_rate(look_ups, time.perf_counter() - started)

    def wait(self) -> None:
        """Wait until all earlier work is finished."""
        self._gpu.device.queue.read_buffer(self[CALL])

    def read(self, binding: int) -> np.ndarray:
        """The contents of a buffer, as float32 array."""
        return np.frombuffer(self._gpu.device.queue.read_buffer(self[binding]), np.float32)

    def close(self) -> None:
        for buffer in self._buffers.values():
            buffer.destroy()


class CachedBuffers:
    """Buffers for the next pictures: with contents of objects that do not change, while these exist, and the last used
    ones up to a number of bytes."""

    def __init__(self, most_bytes: float) -> None:
        self._most_bytes = most_bytes
        self._cached: dict[Any, tuple[weakref.ref, Buffers]] = {}  # the last used one is the last
        self._used: Counter[Any] = Counter()

    @contextmanager
    def of(self, owner: object, kind: Any, make: Callable[[], Buffers]) -> Iterator[Buffers]:
        """The buffers of a kind for an object, for use in a block; `make` makes missing ones."""
        key = id(owner), kind
        if key not in self._cached or self._cached[key][0]() is not owner:
            self._close(key)
            self._cached[key] = weakref.ref(owner), make()
        self._cached[key] = self._cached.pop(key)
        self._used[key] += 1
        try:
            self._close_unneeded(self._most_bytes)
            yield self._cached[key][1]
        finally:
            self._used -= Counter([key])

    def _close_unneeded(self, most_bytes):
        """Close buffers of objects that have ceased to exist, and beyond the limit those not used for longest."""
        left = most_bytes
        for key, (owner, buffers) in reversed(list(self._cached.items())):
            left -= buffers.nbytes
            if not self._used[key] and (owner() is None or left < 0):
                self._close(key)

    def close(self) -> None:
        """Close those that are not in use."""
        self._close_unneeded(-1)

    def _close(self, key):
        if key in self._cached:
            self._cached.pop(key)[1].close()


@lru_cache
def cached_buffers(gpu: Gpu) -> CachedBuffers:
    """The buffers that a graphics processor keeps."""
    return CachedBuffers(CACHE_BYTES)


@contextmanager
def leaving_to_c(gpu: Gpu) -> Iterator[None]:
    """Leave a block that fails, or lacks memory, to C, after a warning."""
    try:
        yield
    except MemoryError as problem:
        gpu.warn(problem)
        with suppress(Exception):  # of a device that was lost as well
            gpu.call(cached_buffers(gpu).close)
    except Exception as problem:  # drivers fail in many ways
        gpu.give_up(problem)
