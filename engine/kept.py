"""What the frames of an animation share, kept between them: the plan, and each wavelength's way through the lens."""

import math
from collections.abc import Iterator

from . import kernels
from .channel import Channel
from .depth.cast import casting_bytes
from .field.psf_table import PsfTables
from .image.layers import LayeredRadiance, light_of
from .image.spectral_image import SpectralImage
from .lens import Lens
from .memory import MemoryBudget
from .plan.choose import make_plan
from .plan.cost import in_process
from .plan.options import Options
from .plan.plan import Plan
from .plan.remembered import remembered_plan
from .scratch import SAMPLE_BYTES, in_file


class Kept:
    """Plans, PSFs, OTFs and footprints of earlier pictures. Give the same one with every frame of an animation.

    Parameters
    ----------
    limit_mb : float
        Memory to keep them in; what does not fit is made anew with each frame.
    remember : bool
        Whether the plan may be one that was made before, for anybody; for measuring it may not.

    Notes
    -----
    It serves one picture after another: of threads, give each one its own.
    """

    def __init__(self, limit_mb: float = 1024, *, remember: bool = True) -> None:
        self._limit_bytes, self._make_plan = limit_mb * 1e6, remembered_plan if remember else make_plan
        self._plans: dict[tuple, Plan] = {}
        self._channels: dict[float, Channel] = {}
        self._memory = MemoryBudget(0)
        self._of: tuple | None = None

    def plan(self, options: Options, lens: Lens, radiance: SpectralImage | LayeredRadiance,
             in_place: bool = False) -> Plan:
        """The plan for a picture; the same for pictures of the same grid and wavelengths.

        `in_place` its irradiance takes the radiance's own memory.

        Raises
        ------
        ImageError, InputError, LensError
            As `make_plan`, and where it takes more memory than there is.
        """
        picture = radiance.dark() if isinstance(radiance, LayeredRadiance) else radiance
        casting = casting_bytes(radiance, options.most_of_lamps) if isinstance(radiance, LayeredRadiance) else 0.0
        spared = in_place or in_file(light_of(radiance))
        irradiance = 0 if spared else SAMPLE_BYTES * picture.wavelengths_nm.size * math.prod(picture.frame_px)
        key = options, lens, picture.grid, tuple(picture.wavelengths_nm), irradiance + casting
        if key not in self._plans:
            self._plans = {key: in_process(self._make_plan(options, lens, picture), irradiance + casting)}
        return self._plans[key]

    def channels(self, lens: Lens, radiance: SpectralImage, plan: Plan) -> Iterator[Channel]:
        """Each wavelength's way through the lens, one after another."""
        of = lens, tuple(radiance.wavelengths_nm), radiance.grid, plan, kernels.running()
        if of != self._of:  # what was kept is of no more use
            self._of, self._memory, self._channels = of, MemoryBudget(self._limit_bytes), {}
        grid = radiance.grid.finer(plan.supersampling)

        def tables(part, method):
            return PsfTables(lens, radiance.wavelengths_nm, plan.planes(grid), part, method.azimuths, plan.precision)

        psfs = tables(plan.trimmed, plan.method) if plan.method.azimuths else None
        halos = tables(plan.halo, plan.halo_method) if plan.halo_density else None
        for wavelength_nm in radiance.wavelengths_nm:
            yield self._channel(lens, float(wavelength_nm), grid, plan, psfs, halos)

    def _channel(self, lens, wavelength_nm, grid, plan, psfs, halos):
        channel = self._channels.get(wavelength_nm)
        if channel is None:
            table = plan.method.table(psfs.at_wavelength(wavelength_nm)) if psfs else None
            make_halos = (lambda: plan.halo_method.table(halos.at_wavelength(wavelength_nm))) if halos else None
            channel = Channel(lens, wavelength_nm, grid, plan, table, self._memory, make_halos)
            if channel.kept:
                self._channels[wavelength_nm] = channel
        return channel
