"""The samples of a capture's passes: one pass takes all, the others a few, with that pass as their control variate.

Samples may be in the parts of pixels, which resolve how light is distributed inside pixels (`Detail`).

The passes of a frame share their seed, so their noise is correlated: see `engine/spectral/control_variate.py`. The
noise that the control variate leaves is estimated from the two halves of the few samples. A pass with too much of it
takes more samples.

The few are the last samples. Cycles takes the first sample of each pixel at its centre for every seed, so a few samples
with that one are biased: with the emission of small lamps, by several per cent of the light in 16 x 16 pixels. It is
also the one with the depth.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from lensfield.engine.plan.options import OFF
from lensfield.engine.runtime.scratch import new_array, release_memory
from lensfield.engine.spectral.control_variate import estimate, noise_growth, remaining_shares
from lensfield.engine.spectral.wavelength_choice import STANDARD

from ..job.steps import Work
from ..scene.denoise import denoised, guide_planes, render_with_guides
from ..scene.render_state import (
    divide_samples,
    effective_samples,
    read_again,
    rendered_layer,
    show_noise,
    show_samples,
    show_slab,
)
from ..scene.undo import Journal
from .bands import WAVELENGTHS_PER_PASS
from .light import PassLight, place_in

FEW, LEAST_FEW = 32, 4  # the first number of samples to try: one in 32, but at least 4
ADAPTIVE_FEW = 64  # one in 64 of the limit of adaptive sampling, which takes fewer
LEVELS = 4  # numbers of samples to try, each twice the one before
MOST_GROWTH = 1.2  # noise in three quarters of the picture, relative to a pass with all samples
FINER = 2  # parts of a pixel, down and across, in the rest of a pass's samples
LEAST_FINE = 4  # samples of such a part
MOST_FINE_PX = 2**25  # parts in a capture: larger pictures would take too much memory
CONTROL_CUBES = LEVELS + 2  # pictures that a control variate stores for each slab


def shares_noise(scene, job, plan):
    """Whether one pass is the control variate of the others."""
    return (job.spectral.tier == STANDARD and _may_divide_samples(scene, job) and len(plan.bands) > 1
            and plan.per_pass == WAVELENGTHS_PER_PASS and effective_samples(scene) >= 2 * LEAST_FEW)


def _may_divide_samples(scene, request):
    """Whether parts of a pass's samples may be rendered one by one. Cycles takes the ratio of a pixel's light with and
    without the shadows on a catcher, and the mean of ratios of few samples is another one."""
    cycles = scene.cycles
    catches = any(each.is_shadow_catcher and each.type != "LIGHT" for each in scene.objects)
    return not request.traced and not cycles.time_limit and not cycles.use_sample_subset and not catches


def detail_times(scene, request, pixels):
    """How often one pass divides the pixels of a capture, down and across; 1 for undivided pixels."""
    if (request.options.detail == OFF or request.spectral.tier == "preview" or pixels * FINER**2 > MOST_FINE_PX
            or not _may_divide_samples(scene, request)):
        return 1
    ends = _sample_ends(scene)
    return FINER if ends[-1] - ends[-2] >= LEAST_FINE * FINER**2 else 1


class WholePasses:
    """The passes of a capture, each with all samples.

    Parameters
    ----------
    passes : FinishedPasses
    path : Path
        The file that a render writes.
    count : int
        Number of passes.

    Attributes
    ----------
    order : list of int
        Indices of the passes, in rendering order.
    times : int
        Into how many parts, down and across, one pass divides its pixels.
    """

    text, times = "", 1

    def __init__(self, passes, path, count):
        self._passes, self._path, self.order = passes, path, list(range(count))

    def share(self, index):
        """Fraction of the capture's samples that a pass is expected to take."""
        return 1 / len(self.order)

    def light(self, index, gathered, step):
        """Steps that render a pass; returns its PassLight.

        Parameters
        ----------
        index : int
            Of the pass; the scene is set to its wavelengths.
        gathered : GatheredLight
            Of the slab that the scene shows.
        step : RenderPass
        """
        planes = yield from self._passes.planes(step, self._path, gathered.planes, index, *gathered.slab.facts)
        return gathered.light_of(planes)


class DetailedPasses(WholePasses):
    """The passes of a capture, each with all samples. The first pass distributes its samples over the parts of pixels.

    Parameters
    ----------
    passes, path, count
        As for `WholePasses`.
    scene : bpy.types.Scene
    capture : PixelGrid
    times : int
        From `detail_times`, above 1.
    """

    def __init__(self, passes, path, count, scene, capture, times):
        super().__init__(passes, path, count)
        self.order.insert(0, self.order.pop((count - 1) // 2))  # the one in the middle of the spectrum
        self._scene, self._capture, self.times = scene, capture, times

    def light(self, index, gathered, step):
        if index != self.order[0]:
            return (yield from super().light(index, gathered, step))
        times, slab = self.times, gathered.slab
        with Journal() as journal:
            show_slab(self._scene, slab.finer(times), self._capture.finer(times), journal)
            divide_samples(self._scene, times**2, journal)
            read_again(self._scene)
            planes = yield from self._passes.planes(step, self._path, gathered.planes, index, times, *slab.facts)
        read_again(self._scene)
        detail = gathered.detail_of(index, gathered.picture(planes), times)
        whole = gathered.in_whole_pixels(planes, gathered.planes, times)
        return replace(gathered.light_of(whole), detail=detail)

    @property
    def text(self):
        return _detail_text(self.times)


class SampledPasses(WholePasses):
    """The passes of a capture, one with all samples and the others with few.

    Parameters
    ----------
    passes, path, count
        As for `WholePasses`.
    scene : bpy.types.Scene
        Its number of samples is changed through the journal.
    scratch : Path or None
        A folder for scratch files; None for memory.
    journal : Journal
    denoise : bool
        Whether to denoise the pass with all samples, and the estimates of the others.
    capture : PixelGrid
    times : int
        From `detail_times`. The first pass has a detail if it is above 1.
    """

    def __init__(self, passes, path, count, scene, scratch, journal, denoise, capture, times):
        super().__init__(passes, path, count)
        self.order.insert(0, self.order.pop((count - 1) // 2))  # the one in the middle of the spectrum
        self._scene, self._scratch, self._journal = scene, scratch, journal
        self._capture, self.times = capture, times
        self._guides = guide_planes(scene) if denoise else []
        if denoise:
            render_with_guides(scene, journal)
        self._samples, self._adaptive = effective_samples(scene), scene.cycles.use_adaptive_sampling
        self._ends = _sample_ends(scene)
        self._controls, self._taken = {}, []
        layer = rendered_layer(scene)
        journal.set(scene.cycles, "samples", self._samples)
        journal.set(layer, "samples", 0)  # no override of the scene's samples
        journal.set(layer.cycles, "pass_debug_sample_count", self._adaptive)
        if self._adaptive and times > 1:
            show_noise(scene, times, journal)
        self._count_plane = f"{layer.name}.Debug Sample Count.X"

    def share(self, index):
        few = self._ends[2] / self._samples
        return (1.0 if index == self.order[0] else few) / (1 + (len(self.order) - 1) * few)

    def light(self, index, gathered, step):
        steps = self._control_steps if index == self.order[0] else self._helped_steps
        light = yield from steps(index, gathered, step)
        return denoised_light(self._scene, light, self._path.parent) if self._guides else light

    def _control_steps(self, index, gathered, step):
        """Steps of the pass with all samples; returns its PassLight."""
        parts = []
        for span in pairwise(self._ends):
            parts.append(self._stored((yield from self._range(index, gathered, step, *span))))
        self._controls[gathered] = _Control(gathered.slab, parts)
        return replace(mean_light(parts), detail=parts[-1].light.detail)

    def _helped_steps(self, index, gathered, step):
        """Steps of a pass with few samples, or with all if these leave too much noise; returns its PassLight."""
        control, parts = self._controls[gathered], []
        control.limit(gathered.slab)
        for span in pairwise([0, *self._ends[control.first_level:]]):
            parts.append((yield from self._range(index, gathered, step, *span)))
            if 1 < len(parts) and span[1] < self._samples:
                light, growth = yield Work(lambda _: control.help(parts), "Estimating wavelengths", step.fraction)
                if growth <= MOST_GROWTH:
                    control.first_level += len(parts) - 2  # the next pass takes about as many
                    self._taken.append((span[1], growth))
                    return light
        control.first_level = len(self._ends) - 3
        self._taken.append((self._samples, 1.0))
        return mean_light(parts)

    def _range(self, index, gathered, step, first, last):
        """Steps that render a range of a pass's samples, counted from the last one; returns Samples."""
        rest = last == self._samples
        adaptive, times = self._adaptive and rest, self.times if rest else 1
        begin, count = self._samples - last, last - first
        if times > 1:
            count = _power_of_two(count / times**2)
        show_slab(self._scene, gathered.slab.finer(times), self._capture.finer(times), self._journal)
        show_samples(self._scene, begin, begin + count, adaptive, self._journal)
        needed = [*gathered.planes, *self._guides, *[self._count_plane] * adaptive]
        step = replace(step, share=step.share * (last - first) / self._samples)
        planes = yield from self._passes.planes(step, self._path, needed, index, first, last, times,
                                                *gathered.slab.facts)
        detail = None
        if times > 1:
            if index == self.order[0]:
                detail = gathered.detail_of(index, self._picture(gathered, planes), times)
            planes = gathered.in_whole_pixels(planes, needed, times)
            count *= times**2
        if adaptive:
            count *= planes[self._count_plane]
        return Samples(count, replace(gathered.light_of(planes, self._guides), detail=detail))

    def _picture(self, gathered, planes):
        """The light of all lamps in a pass, denoised if requested: array (channel, row, column)."""
        picture = gathered.picture(planes)
        if not self._guides:
            return picture
        guides = np.array([planes[name] for name in self._guides])
        return denoised(self._scene, picture[::-1], planes[gathered.planes[0]], guides, self._path.parent)[::-1]

    def _stored(self, part):
        """The Samples, in a scratch file if there is a folder for them."""
        if self._scratch is None:
            return part
        cube = new_array(part.light.cube.shape, self._scratch)
        cube[:] = part.light.cube
        release_memory(cube)
        return replace(part, light=replace(part.light, cube=cube))

    @property
    def text(self):
        """The samples of the passes, and their noise, in one line."""
        numbers = sorted({taken for taken, _ in self._taken})
        return (f"{' or '.join(map(str, numbers))} of {self._samples} samples in {len(self.order) - 1} of "
                f"{len(self.order)} passes, with the other pass as control variate: three quarters of the picture have "
                f"at most {max(growth for _, growth in self._taken):.2f} times the noise of all samples" + (
                    f"; {_detail_text(self.times)}" if self.times > 1 else ""))


def _detail_text(times):
    return f"detail of {times} x {times} parts of each pixel"


def _power_of_two(number):
    """The power of two that is closest to a number, by their ratio: such samples have the least noise together."""
    return 2 ** max(0, round(np.log2(number)))


def _sample_ends(scene):
    """The `_ends` of a scene's samples."""
    samples = effective_samples(scene)
    return _ends(samples, samples // (ADAPTIVE_FEW if scene.cycles.use_adaptive_sampling else FEW))


def _ends(samples, few):
    """Where the ranges of a pass's samples begin and end, counted from the last sample: two halves of the few, as many
    for each further level, the rest."""
    half = max(few, LEAST_FEW) // 2
    ends = [half * 2**level for level in range(LEVELS + 1)]
    return [0, *(end for end in ends if 2 * end <= samples), samples]


@dataclass(frozen=True, eq=False)
class Samples:
    """The light of a range of a pass's samples.

    Attributes
    ----------
    count : int or float32 array (row, column)
        Number of samples.
    light : PassLight
    """

    count: int | np.ndarray
    light: PassLight

    def within(self, part):
        """The same samples in a part of the picture, given as slices of rows and columns."""
        return Samples(self.count[part] if np.ndim(self.count) else self.count, self.light.within(part))


def denoised_light(scene, light, folder):
    """The denoised PassLight, whose lamps are in one group. The folder is for files."""
    picture = denoised(scene, light.cube[0, ::-1], light.alpha, light.guides, folder)
    return replace(light, cube=picture[None, ::-1])


def _mean_alpha(parts):
    return _weighted([(part.count, part.light.alpha) for part in parts])


def mean_light(parts):
    """The mean light of some Samples: PassLight, with the depth of the last."""
    return _planes_with(_weighted([(part.count, part.light.cube) for part in parts]), parts)


def _planes_with(cube, parts):
    """A PassLight of this cube, with the mean alpha and guides of some Samples, and the depth of those with the first
    sample, which are last."""
    guides = _weighted([(part.count, part.light.guides) for part in parts])
    return PassLight(cube, _mean_alpha(parts), parts[-1].light.depth_m, guides)


def _weighted(counted):
    """The mean of planes, each with its number of samples."""
    total = sum(count for count, _ in counted)
    return sum(np.float32(count / total) * plane for count, plane in counted)


class _Control:
    """A slab's pass with all samples, as the control variate of the others.

    Parameters
    ----------
    slab : Slab
    parts : list of Samples
        By ranges of samples, as in `_ends`.

    Attributes
    ----------
    first_level : int
        Index in `_ends` of the end of the next pass's first range.
    """

    def __init__(self, slab, parts):
        self._region, self.parts, self.first_level = slab.region, parts, 1

    def limit(self, slab):
        """Limit the control variate to the region of the slab, which may have narrowed."""
        part = place_in(self._region, slab.region)
        self._region, self.parts = slab.region, [each.within(part) for each in self.parts]

    def help(self, parts):
        """Estimate the light of another pass.

        Parameters
        ----------
        parts : list of Samples
            Its first ranges: all but the last together are as many samples as the last.

        Returns
        -------
        PassLight
        growth : float
            From `noise_growth`.
        """
        count = self.first_level + len(parts) - 1
        few, rest = self.parts[:count], self.parts[count:]
        few_count, rest_count = 2 * parts[-1].count, sum(part.count for part in rest)
        weight = np.float32(rest_count / (rest_count + few_count))
        cube, helped, unhelped = np.empty_like(parts[0].light.cube), 0, 0
        for lamp in range(len(cube)):
            halves, control_halves = ([_lamp(ranges[:-1], lamp), _lamp(ranges[-1:], lamp)] for ranges in (parts, few))
            cube[lamp], difference = estimate(halves, control_halves, _lamp(rest, lamp), weight)
            helped, unhelped = helped + difference, unhelped + (halves[0] - halves[1])
        growth = noise_growth(remaining_shares(helped, unhelped), few_count, float(np.mean(rest_count)) + few_count)
        light = _planes_with(cube, self.parts)
        more = np.subtract(*(_mean_alpha(ranges) for ranges in (parts, few)))  # exactly 0 for an alpha without a colour
        return replace(light, alpha=np.clip(light.alpha + more, 0, 1)), growth


def _lamp(parts, lamp):
    """The mean light of a lamp: array (channel, row, column)."""
    return _weighted([(part.count, part.light.cube[lamp]) for part in parts])
