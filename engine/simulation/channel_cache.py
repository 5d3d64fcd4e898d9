"""Cache of the data that frames of an animation share: the plan, and a channel for each wavelength."""

import math
from collections.abc import Iterator

from ..depth.cast import casting_bytes
from ..field.field_map import field_map
from ..image.detail import splitting_bytes
from ..image.layers import Radiance
from ..image.sampling import Sampling
from ..kernels.library import running
from ..lens import Lens
from ..plan.choose import make_plan
from ..plan.cost import in_process
from ..plan.options import Options
from ..plan.plan import Plan
from ..plan.plan_cache import cached_plan
from ..runtime.memory import MemoryBudget
from ..runtime.scratch import SAMPLE_BYTES, in_file
from .channel import Channel


class ChannelCache:
    """Cache of plans, PSFs, OTFs and footprints. Pass the same one with every frame of an animation.

    Parameters
    ----------
    limit_mb : float
        Memory for the cache; data beyond this are computed again for each frame.
    cache_plans : bool
        Whether the plan may come from the cache of earlier plans, in the process and on disk; False for measurements.

    Attributes
    ----------
    limit_bytes : float

    Notes
    -----
    Not thread-safe: use a separate one in each thread.

    Examples
    --------
    Two frames of an animation share the plan and the PSFs:

    >>> import numpy as np
    >>> from lensfield import ChannelCache, Options, SpectralImage, load_lens, simulate
    >>> lens, cache = load_lens("edmund-54852"), ChannelCache(limit_mb=64)
    >>> for light in (1.0, 0.5):
    ...     frame = SpectralImage(np.full((24, 32), light), wavelengths_nm=[550], pitch_um=15)
    ...     irradiance = simulate(frame, lens, Options(accuracy=0.1), cache=cache)
    >>> irradiance.cube.shape
    (1, 24, 32)
    """

    def __init__(self, limit_mb: float = 1024, *, cache_plans: bool = True) -> None:
        self.limit_bytes, self._make_plan = limit_mb * 1e6, cached_plan if cache_plans else make_plan
        self._plan: tuple[tuple | None, Plan | None] = None, None
        self._channels: dict[float, Channel] = {}
        self._memory = MemoryBudget(0)
        self._of: tuple | None = None

    def plan(self, options: Options, lens: Lens, radiance: Radiance,
             in_place: bool = False) -> Plan:
        """The plan for a picture; the same for pictures of the same sampling.

        With `in_place`, the irradiance overwrites the radiance in its memory.

        Raises
        ------
        ImageError, InputError, LensError
            As `make_plan`, and if there is not enough memory.
        """
        sampling, known = radiance.sampling, radiance.detail_times
        casting = casting_bytes(radiance, lens, options.most_of_lamps)
        spared = in_place or in_file(radiance.light)
        irradiance = 0 if spared else SAMPLE_BYTES * len(sampling.wavelengths_nm) * math.prod(sampling.grid.frame_px)
        key = options, lens, sampling, known, irradiance + casting
        of, plan = self._plan
        if plan is None or key != of:  # the same lens is equal without a digest of its data
            plan = self._make_plan(options, lens, sampling, known)
            splitting = splitting_bytes(math.prod(sampling.grid.shape_px), plan.known)
            plan = in_process(plan, irradiance + casting + splitting)
            self._plan = key, plan
        return plan

    def channels(self, lens: Lens, sampling: Sampling, plan: Plan, across: int = 1) -> Iterator[Channel]:
        """Yield the channel of each wavelength, in order, for radiance with each pixel split into the plan's parts, and
        each of these into columns."""
        of = lens, sampling, plan, running(), across
        if of != self._of:  # the cached channels no longer apply
            self._of, self._memory, self._channels = of, MemoryBudget(self.limit_bytes), {}
        fine, field, capture = sampling.finer(plan.supersampling), field_map(lens), sampling.grid.finer(plan.parts)
        capture = capture.finer_across(across)

        def tables(part, method):
            return field.node_psfs(fine, plan.planes(fine.grid), part, method.azimuths, plan.precision)

        psfs = tables(plan.trimmed, plan.method) if plan.method.tabulated else None
        halos = tables(plan.halo, plan.halo_method) if plan.halo_density else None
        for wavelength_nm in sampling.wavelengths_nm:
            yield self._channel(field, wavelength_nm, fine.grid, plan, psfs, halos, capture)

    def _channel(self, field, wavelength_nm, grid, plan, psfs, halos, capture):
        channel = self._channels.get(wavelength_nm)
        if channel is None:
            table = plan.method.table(psfs.at_wavelength(wavelength_nm)) if psfs else None
            make_halos = (lambda: plan.halo_method.table(halos.at_wavelength(wavelength_nm))) if halos else None
            channel = Channel(field.at_wavelength(wavelength_nm), grid, plan, table, self._memory, make_halos,
                              capture)
            if channel.cached:
                self._channels[wavelength_nm] = channel
        return channel
