"""Make the levels of layers on a graphics processor, by levels.wgsl, from planes that stay there for later pictures."""

import math
from collections.abc import Iterable
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Any

import numpy as np

from ..runtime.threads import thread_pool
from .gpu import Gpu
from .gpu_calls import CALL, Buffers, bound, cached_buffers, compiled, submit
from .levels import (
    EVERYWHERE,
    HALVING,
    LayerPlanes,
    LevelKind,
    Place,
    Sides,
    halved_first,
    halved_widths,
    smoothing,
)

WIDE, TALL = 32, 4  # pixels of a workgroup
PER_LOOK_UP = 8  # pixels next to each other in the time of a look-up
PASS_BYTES = 256  # between the numbers of passes, as devices require
NAMES = "filter_planes", "sharpen", "find_visible", "leave_out_hidden", "divide"
PASS = np.dtype([(name, kind) for kind, names in (
    ("u4", "source to other source_rows source_columns rows columns other_rows other_columns first_row"),
    ("i4", "other_row other_column"), ("u4", "along_columns"), ("i4", "step before"),
    ("u4", "taps on_before on_behind alpha"), ("f4", "near_px")) for name in names.split()] + [("weights", "f4", 16)])
SOURCE, OTHER, TO = range(CALL + 1, CALL + 4)  # bindings


@dataclass(frozen=True)
class Stack:
    """Planes in a buffer.

    Attributes
    ----------
    buffer : wgpu.GPUBuffer
    begin : int
        The first float.
    first : (int, int)
        The first row and column, in its own pixels from the capture's first.
    shape : (int, int, int)
        Planes, rows, columns.
    """

    buffer: Any
    begin: int
    first: tuple[int, int]
    shape: tuple[int, int, int]

    @property
    def place(self) -> Place:
        return self.first, self.shape[1:]


def level_place(place: Place, kind: LevelKind) -> Place:
    """The place of a level of planes in the level's pixels."""
    size = 1
    while size < kind.size:
        place, size = _halved_place(place), 2 * size
    width, _ = smoothing(kind.averages)
    return (place[0][0] - width, place[0][1] - width), (place[1][0] + 2 * width, place[1][1] + 2 * width)


def _halved_place(place):
    rows, columns = ((n + sum(widths) - 3) // 2 for n, widths in zip(place[1], halved_widths(place), strict=True))
    return halved_first(place[0]), (rows, columns)


def make_levels(gpu: Gpu, layer: LayerPlanes, levels: dict[int, Stack]) -> None:
    """Write levels of a layer, by their numbers, to their stacks.

    Only for functions that `Gpu.call` runs.
    """
    if "levels" not in gpu.pipelines:
        gpu.pipelines["levels"] = dict(zip(NAMES, compiled(gpu, "levels.wgsl", NAMES, WIDE=WIDE, TALL=TALL),
                                           strict=True))
    planes = len(layer.light) + 1
    with ExitStack() as stack:
        cached = stack.enter_context(_cached_planes(gpu, layer))
        work = _Work(gpu, stack.enter_context(closing(Buffers(gpu))))
        source = Stack(cached[SOURCE], 0, layer.origin_px, (planes, *layer.alpha.shape))
        if finest := levels.get(0):
            work.make_finest(source, finest, layer.sharp)
        coarser = {kind: levels[n] for n, kind in enumerate(layer.coarser, 1) if kind and n in levels}
        work.soften(source, layer.sides, coarser)
        if layer.nearer:
            cover, apart = work.uploaded(layer.nearer.cover), work.uploaded(layer.nearer.apart_px)
            for kind, level in coarser.items():
                if layer.nearer.hides(kind):
                    work.leave_out_hidden(source, layer.sides, cover, apart, kind, level)
        work.submit()


def _cached_planes(gpu, layer):
    """A layer's light and alpha, as a context manager of buffers: uploaded unless they are there."""
    def upload():
        buffers = Buffers(gpu)
        light = layer.light if layer.scale == 1 else layer.light * np.float32(layer.scale)
        buffers.put(SOURCE, light, layer.alpha)
        return buffers

    light, owner = layer.light, layer.light
    while isinstance(owner.base, np.ndarray):
        owner = owner.base
    kind = light.ctypes.data, light.shape, light.strides, layer.scale, _sums([*light, layer.alpha])
    return cached_buffers(gpu).of(owner, kind, upload)


def _sums(planes: Iterable[np.ndarray]) -> bytes:
    """A digest of sums over the bits of planes by row and by column: it changes if the contents of the planes do."""
    with thread_pool() as pool:
        return sha256(b"".join(pool.map(_sums_of_plane, planes))).digest()


def _sums_of_plane(plane):
    plane = plane if plane.strides[1] == plane.itemsize else np.ascontiguousarray(plane)
    words = plane.view(np.uint32 if plane.shape[1] % 2 else np.uint64)  # twice as fast
    return b"".join(np.add.reduce(words, axis, np.uint64).tobytes() for axis in (0, 1))


class _Work:
    """Passes over stacks of planes; those between the first and the last pass are in scratch buffers.

    Passes are collected, because each submission takes as long as several of them.
    """

    def __init__(self, gpu, scratch):
        self._gpu, self._scratch, self._count = gpu, scratch, 0
        self._passes, self._look_ups = [], 0.0
        self._by_role = {}

    def _stack(self, role, first, shape):
        """A stack in the scratch buffer of a role: it replaces the last one of this role."""
        size = 4 * math.prod(shape)
        if role not in self._by_role or self._by_role[role].size < size:
            self._count += 1
            self._scratch.make(self._count, size)
            self._by_role[role] = self._scratch[self._count]
        return Stack(self._by_role[role], 0, first, shape)

    def uploaded(self, plane: np.ndarray) -> Stack:
        """A plane of the capture."""
        self._count += 1
        self._scratch.put(self._count, plane)
        return Stack(self._scratch[self._count], 0, (0, 0), (1, *plane.shape))

    def make_finest(self, source: Stack, to: Stack, sharp: bool) -> None:
        """The first level: the light, which may be sharpened, and alpha; with at least two rows and columns."""
        self._filter(source, to, 1, [1.0])
        if not sharp:
            return
        planes = source.shape[0] - 1
        light = replace(source, shape=(planes, *source.shape[1:]))
        between = self._stack("between", source.first, light.shape)
        self._run("sharpen", light, between, along_columns=1)
        self._run("sharpen", between, replace(to, shape=(planes, *to.shape[1:])))

    def soften(self, source: Stack, sides: Sides, levels: dict[LevelKind, Stack]) -> None:
        """Levels of planes, those with small pixels first."""
        coarse, size = source, 1
        for kind, to in levels.items():
            while size < kind.size:
                coarse, size = self._halved(coarse, sides), 2 * size
            width, weights = smoothing(kind.averages)
            self._filter(coarse, to, 1, weights, 2 * [width + (kind.averages + 1) // 2], sides)

    def _halved(self, source, sides):
        first, shape = _halved_place(source.place)
        to = self._stack("coarse", first, (source.shape[0], *shape))
        self._filter(source, to, 2, np.array(HALVING) / 16, [width for width, _ in halved_widths(source.place)], sides)
        return to

    def leave_out_hidden(self, source: Stack, sides: Sides, cover: Stack, apart: Stack, kind: LevelKind,
                         to: Stack) -> None:
        """Replace pixels of a level by means over parts that are not hidden."""
        visible = self._stack("visible", (0, 0), cover.shape)
        parts = self._stack("parts", source.first, source.shape)
        self._run("find_visible", cover, visible, apart, near_px=kind.near_px)
        self._run("leave_out_hidden", source, parts, visible, alpha=source.shape[0] - 1)
        first, shape = level_place(visible.place, kind)
        shares, means = self._stack("shares", first, (1, *shape)), self._stack("means", to.first, to.shape)
        self.soften(visible, EVERYWHERE, {kind: shares})
        self.soften(parts, sides, {kind: means})
        self._run("divide", means, to, shares)

    def _filter(self, source, to, step, weights, before=(0, 0), sides=EVERYWHERE):
        """Filter along the rows' axis, then along the columns'."""
        between = self._stack("between", source.first, (source.shape[0], to.shape[1], source.shape[2]))
        for axis, (one, other) in enumerate(((source, between), (between, to))):
            on_before, on_behind = sides[axis]
            self._run("filter_planes", one, other, along_columns=axis, step=step, before=before[axis],
                      taps=len(weights), on_before=on_before, on_behind=on_behind,
                      weights=np.pad(weights, (0, 16 - len(weights))))

    def _run(self, name, source, to, other=None, **numbers):
        """A pass over all pixels of `to`, some rows in a call."""
        facts, (planes, rows, columns) = np.zeros((), PASS), to.shape
        facts["source"], facts["to"], facts["rows"], facts["columns"] = source.begin, to.begin, rows, columns
        _, facts["source_rows"], facts["source_columns"] = source.shape
        buffers = {SOURCE: source.buffer, TO: to.buffer}
        if other:
            facts["other"], buffers[OTHER] = other.begin, other.buffer
            _, facts["other_rows"], facts["other_columns"] = other.shape
            facts["other_row"], facts["other_column"] = np.subtract(to.first, other.first)
        for number, value in numbers.items():
            facts[number] = value
        down, across = -(-rows // TALL), -(-columns // WIDE)
        of_row = float(WIDE * TALL * across * planes * max(2, int(facts["taps"])) / PER_LOOK_UP)
        most = max(1, int(self._gpu.look_ups_of_call / of_row))
        for first in range(0, down, most):
            facts["first_row"], count = TALL * first, min(most, down - first)
            if self._look_ups + count * of_row > self._gpu.look_ups_of_call:
                self.submit()
            self._passes.append((name, facts.tobytes(), buffers, (across, count, planes)))
            self._look_ups += count * of_row

    def submit(self) -> None:
        """Run the passes that were collected."""
        if not self._passes:
            return
        self._count += 1
        facts = np.zeros((len(self._passes), PASS_BYTES), np.uint8)
        for to, (_, numbers, *_) in zip(facts, self._passes, strict=True):
            to[:PASS.itemsize] = np.frombuffer(numbers, np.uint8)
        self._scratch.put(self._count, facts, usage="UNIFORM")
        submit(self._gpu, [self._bound(n, *each) for n, each in enumerate(self._passes)])
        self._passes, self._look_ups = [], 0.0

    def _bound(self, number, name, _, buffers, groups):
        pipeline = self._gpu.pipelines["levels"][name]
        call = {"buffer": self._scratch[self._count], "offset": number * PASS_BYTES, "size": PASS.itemsize}
        resources = {CALL: call} | {binding: {"buffer": buffer} for binding, buffer in buffers.items()}
        return pipeline, bound(self._gpu, pipeline, resources), groups
