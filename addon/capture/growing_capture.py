"""A capture that grows, for the preview: first coarse pixels with few samples, then fine ones with more and more.

Each range of a pixel's samples is rendered once and added to those before it.
"""

from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, prod
from time import monotonic

import numpy as np

from lensfield.engine.runtime.files import temporary_folder

from ..scene.denoise import can_denoise, denoise_quickly, guide_planes, render_with_guides
from ..scene.render_state import rendered_layer, show_samples, show_slab
from ..scene.undo import Journal
from .captured import Captured
from .light import place_in
from .radiance import captured_from, light_steps, unfocused_light
from .ready import planned_steps, sliced_steps
from .sampled_passes import Samples, WholePasses, denoised_light, mean_light

FINER = 3  # fine pixels in a coarse one, down and across
LONGEST_S, SHORTEST_S = 0.2, 1e-3  # of a render, which cannot be stopped; and of a sample
COARSE_SAMPLES = 2
FIRST_SAMPLES, GROWTH = 4, 4  # of fine pixels: the first number of samples, and the factor from each to the next


class Moved(Exception):
    """Objects have moved, and nothing else has changed."""


@dataclass(frozen=True, eq=False)
class Grown:
    """A stage of a growing capture.

    Attributes
    ----------
    captured : Captured
    samples : int
        Of each pixel.
    times : int
        1 for coarse pixels, FINER for fine ones.
    """

    captured: Captured
    samples: int
    times: int


def growing_capture(scene, job):
    """Generator of steps, and of a Grown after each stage; send it the return value of each step's call. It yields None
    once all stages are complete.

    The first stage has the scene's pixels; the others have pixels of a third of their side, and up to the scene's
    samples. Throw Moved into it after objects have moved: it begins anew, but with the same plan and stand-ins.
    Closing it at any time restores the scene.

    Parameters
    ----------
    scene : bpy.types.Scene
    job : Job
    """
    with temporary_folder() as folder, Journal() as journal, ExitStack() as alone:
        planned = yield from planned_steps(scene, job, (), folder, journal, alone, FINER)
        while True:
            with suppress(Moved), Journal() as of_stages:
                yield from _stages(planned, of_stages)
                while True:
                    yield None


def _stages(planned, journal, emitters=None):
    """Steps of the stages of a planned scene, and a Grown after each; with Emitters, they do not begin anew."""
    most = planned.scene.cycles.samples
    ready = yield from sliced_steps(planned, 1.0, journal, FINER, emitters)
    passes = _GrowingPasses(ready, journal)
    for times, stages in ((1, [min(most, COARSE_SAMPLES)]), (FINER, sample_ends(most))):
        grid, capture_px = ready.grid.finer(times), ready.capture_px.finer(times)
        slabs = [slab.finer(times) for slab in ready.slabs]
        passes.begin(capture_px)
        for samples in stages:
            passes.last = samples
            lights = yield from light_steps(ready, passes, capture_px, slabs, 1.0, journal)
            captured = captured_from(ready, lights, grid, capture_px)
            if not emitters and (unfocused := unfocused_light(ready, captured)):
                yield from _stages(planned, journal, ready.emitters.together(unfocused))
                return
            yield Grown(captured, samples, times)
            passes.order.reverse()  # the next stage begins with the scene as it is
            slabs = [replace(light.slab, narrows=False) for light in lights]


def sample_ends(samples):
    """The numbers of samples after each stage of fine pixels, up to the given one: list."""
    ends = [min(samples, FIRST_SAMPLES)]
    while ends[-1] < samples:
        ends.append(min(samples, GROWTH * ends[-1]))
    return ends


class _GrowingPasses(WholePasses):
    """The passes of a capture, which each stage adds samples to.

    A pass is rendered in as many parts, by samples and by bands of rows, as are needed to stop within about LONGEST_S.

    Parameters
    ----------
    ready : Ready
    journal : Journal

    Attributes
    ----------
    last : int
        Samples after the current stage.
    """

    def __init__(self, ready, journal):
        super().__init__(ready.passes, ready.path, len(ready.plan.bands))
        self._scene, self._journal = ready.scene, journal
        self._guides = guide_planes(ready.scene) if ready.job.denoises and can_denoise() else []
        self._capture_px, self._parts, self._sample_s = None, {}, 0.0
        if self._guides:
            render_with_guides(self._scene, journal)
            denoise_quickly(self._scene, journal)
        journal.set(rendered_layer(self._scene), "samples", 0)  # no override of the scene's samples
        journal.set(self._scene.cycles, "time_limit", 0.0)

    def begin(self, capture_px):
        """Begin anew, with the pixels of this PixelGrid."""
        if self._capture_px:
            self._sample_s *= prod(capture_px.shape_px) / prod(self._capture_px.shape_px)
        self._capture_px, self._parts = capture_px, {}

    def light(self, index, gathered, step):
        """Steps that render the stage's samples; returns the PassLight of all samples so far."""
        slab, again = gathered.slab, False
        part = self._before(index, slab)
        while (first := part.count if part else 0) < self.last:
            count = round(LONGEST_S / max(self._sample_s, SHORTEST_S)) if self._sample_s else 1
            count = min(self.last - first, max(1, count))
            part = _sum(part, (yield from self._range(index, gathered, step, first, count, again)))
            again = True
        self._parts[index, slab.near_m] = slab.region, part
        return denoised_light(self._scene, part.light, self._path.parent) if self._guides else part.light

    def _range(self, index, gathered, step, first, count, again):
        """Steps that render a range of a pass's samples; returns Samples. `again`: the pass follows another range."""
        needed, planes_of, timed = [*gathered.planes, *self._guides], [], []
        for band in _bands(gathered.slab, ceil(count * self._sample_s / LONGEST_S)):
            begin_s = monotonic()
            show_slab(self._scene, band, self._capture_px, self._journal)
            show_samples(self._scene, first, first + count, False, self._journal)
            planes_of.append((yield from self._passes.planes(step, self._path, needed, index, first, count,
                                                             *band.facts)))
            timed.append((band.region[0].stop - band.region[0].start, monotonic() - begin_s))
        self._learn(timed, count, again)
        planes = {name: np.concatenate([planes[name] for planes in planes_of]) for name in needed}
        return Samples(count, gathered.light_of(planes, self._guides))

    def _learn(self, timed, count, again):
        """Estimate a sample's time from the (rows, seconds) of renders of this many samples.

        The first one at other wavelengths takes longer, mainly for the map of the world's light, however few its
        samples are: it counts only if no other is known.
        """
        usual = timed if again else timed[1:] or ([] if self._sample_s else timed)
        if usual:
            all_rows, (usual_rows, seconds) = sum(rows for rows, _ in timed), map(sum, zip(*usual, strict=True))
            self._sample_s = seconds / count * all_rows / usual_rows

    def _before(self, index, slab):
        """The Samples of the earlier stages, in the slab's region; None at first."""
        region, part = self._parts.get((index, slab.near_m), (None, None))
        return part and part.within(place_in(region, slab.region))


def _bands(slab, number):
    """A Slab for each of a number of bands of its rows, of about the same height."""
    rows, columns = slab.region
    number = max(1, min(number, rows.stop - rows.start))
    borders = np.linspace(rows.start, rows.stop, number + 1).round().astype(int).tolist()
    return [replace(slab, region=(slice(*band), columns)) for band in pairwise(borders)]


def _sum(before, part):
    """The Samples of both, with the depth of the first, which Cycles takes from the first sample."""
    if before is None:
        return part
    light = replace(mean_light([before, part]), depth_m=before.light.depth_m)
    return Samples(before.count + part.count, light)
