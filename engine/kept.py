"""What the frames of an animation share, kept between them: the plan, and each wavelength's way through the lens."""

from .channel import Channel
from .field.psf_table import PolarTables
from .plan.choose import make_plan
from .room import Room


class Kept:
    """Plans, PSFs, OTFs and footprints of earlier pictures. Give the same one with every frame of an animation.

    Parameters
    ----------
    limit_mb : float
        Memory to keep them in; what finds no room is made anew with each frame.
    """

    def __init__(self, limit_mb=1024):
        self._limit_bytes = limit_mb * 1e6
        self._plans, self._of = {}, None

    def plan(self, options, lens, radiance):
        """The plan for a picture; the same for pictures of the same grid and wavelengths."""
        key = (options, lens, radiance.cube.shape, radiance.overscan_px, radiance.centre_px, radiance.pitch_um,
               radiance.projection, tuple(radiance.wavelengths_nm))
        if key not in self._plans:
            self._plans = {key: make_plan(options, lens, radiance)}
        return self._plans[key]

    def channels(self, lens, wavelengths_nm, grid, plan):
        """Each wavelength's way through the lens, one after another."""
        of = lens, tuple(wavelengths_nm), grid, plan
        if of != self._of:  # what was kept is of no more use
            self._of, self._room, self._channels, self._tables = of, Room(self._limit_bytes), {}, None
            if plan.azimuths:
                self._tables = PolarTables(lens, wavelengths_nm, grid.pitch_um, plan.support_um, plan.azimuths,
                                           plan.folded, plan.precision)
        for wavelength_nm in wavelengths_nm:
            channel = self._channels.get(wavelength_nm)
            if channel is None:
                channel = Channel(lens, wavelength_nm, grid, plan, self._tables, self._room)
                if channel.kept:
                    self._channels[wavelength_nm] = channel
            yield channel
