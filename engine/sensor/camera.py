"""A camera's sensor, described by the parameters of EMVA Standard 1288."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..runtime.errors import CameraError
from ..runtime.values import Value

MOST_PX = 2**16  # along a side
MOST_BITS = 16
LARGEST_CELL = 64
PARTS = "size", "sensitivity", "noise"
ORIGINS = "measured", "published", "generic"
POSITIVE = ("pitch_um", "gain_dn_per_e", "base_iso", "saturation_e", "pixel_aperture")
NOT_NEGATIVE = ("black_dn", "dark_noise_e", "readout_noise_dn", "dark_current_e_per_s", "dsnu_e", "prnu", "crosstalk")
UP_TO_1 = ("pixel_aperture", "crosstalk")
NUMBERS = POSITIVE + NOT_NEGATIVE
LEAST, MOST, PITCH_LIMITS_UM = 1e-6, 1e9, (1e-2, 1e4)
WAVELENGTH_LIMITS_NM = 10.0, 1e5
"""Limits of each number, beyond those of any sensor: squares and products remain finite at all exposures."""


@dataclass(frozen=True, eq=False, repr=False)
class Camera(Value):
    """A digital camera's sensor, with the parameters of the linear model of EMVA Standard 1288.

    Attributes
    ----------
    name : str
    shape_px : (int, int)
        Rows and columns.
    pitch_um : float
        Distance between the centres of its square pixels; the light on a pixel is that on pitch x pitch.
    filters : tuple of str
        Cell of the colour filter array, repeated over the sensor: a letter for each pixel, a string for each row, from
        the top left. Empty for a sensor whose pixels have all channels (three chips).
    channels : str
        Letters of the channels, in the order of `quantum_efficiency`.
    wavelengths_nm : array (wavelength,)
        Ascending.
    quantum_efficiency : array (channel, wavelength)
        Electrons for each photon on a pixel; linear between the wavelengths, 0 beyond.
    gain_dn_per_e : float
        K, the overall system gain at `base_iso`, in digital numbers per electron.
    base_iso : float
        K is proportional to the ISO.
    saturation_e : float
        Full well: electrons that a pixel holds. The digital numbers may end below it.
    bits : int
    black_dn : float
        Digital number of a pixel without electrons.
    dark_noise_e : float
        Part of the temporal dark noise sigma_d that arises before the gain, in electrons.
    readout_noise_dn : float
        Part that arises after the gain, without quantisation, in digital numbers.
    dark_current_e_per_s : float
    dsnu_e : float
        DSNU1288, the spatial standard deviation of the dark signal, in electrons.
    prnu : float
        PRNU1288, the spatial standard deviation of the response over its mean.
    pixel_aperture : float
        Side of the square of light that a pixel's microlens collects, in pitches. The MTF of pixels of side a is
        sin(pi a f) / (pi a f) at f cycles per pitch. Even light gives the same electrons through any.
    crosstalk : float
        Share of a pixel's electrons that its four neighbours receive in equal parts.
    title, maker : str
        What lists of cameras show.
    source, notes : str
        The origin of the figures, and the assumptions.
    provenance : tuple of (str, str)
        A part of the figures and its origin, of `PARTS` and `ORIGINS`.

    Raises
    ------
    CameraError
        A parameter is missing or invalid.

    Examples
    --------
    >>> from lensfield import Camera
    >>> camera = Camera("MINE", shape_px=(3000, 4000), pitch_um=3.0, filters=("RG", "GB"), channels="RGB",
    ...                 wavelengths_nm=[400, 550, 700], quantum_efficiency=[[0, 0, 0.4], [0, 0.5, 0], [0.3, 0, 0]],
    ...                 gain_dn_per_e=0.35, base_iso=100.0, saturation_e=10000.0, bits=12, black_dn=64.0)
    >>> camera.size_mm, camera.white_dn
    ((12.0, 9.0), 4095)
    """

    name: str
    shape_px: tuple[int, int]
    pitch_um: float
    filters: tuple[str, ...]
    channels: str
    wavelengths_nm: np.ndarray
    quantum_efficiency: np.ndarray
    gain_dn_per_e: float
    base_iso: float
    saturation_e: float
    bits: int
    black_dn: float = 0.0
    dark_noise_e: float = 0.0
    readout_noise_dn: float = 0.0
    dark_current_e_per_s: float = 0.0
    dsnu_e: float = 0.0
    prnu: float = 0.0
    pixel_aperture: float = 1.0
    crosstalk: float = 0.0
    title: str = field(default="", repr=False)
    maker: str = field(default="", repr=False)
    source: str = field(default="", repr=False)
    notes: str = field(default="", repr=False)
    provenance: tuple[tuple[str, str], ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "wavelengths_nm", np.asarray(self.wavelengths_nm, dtype=np.float64))
        object.__setattr__(self, "quantum_efficiency", np.asarray(self.quantum_efficiency, dtype=np.float64))
        _check(self)
        super().__post_init__()

    @property
    def white_dn(self) -> int:
        """The highest digital number."""
        return 2**self.bits - 1

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the sensor."""
        rows, columns = self.shape_px
        return columns * self.pitch_um * 1e-3, rows * self.pitch_um * 1e-3

    @property
    def turned(self) -> "Camera":
        """The camera turned by 90 degrees: its rows are columns of this one, from the right."""
        rows, columns = self.shape_px
        cell = ["".join(row[(columns - 1 - index) % len(row)] for row in self.filters)
                for index in range(len(self.filters[0]))] if self.filters else ()
        return replace(self, shape_px=(columns, rows), filters=tuple(cell))

    def gain_at(self, iso: float) -> float:
        """K at an ISO, in digital numbers per electron."""
        return self.gain_dn_per_e * iso / self.base_iso

    def dark_noise_at(self, iso: float) -> float:
        """sigma_d at an ISO, in electrons."""
        return float(np.sqrt(self.dark_noise_e**2 + (self.readout_noise_dn / self.gain_at(iso))**2))

    def dark_spread_dn(self, iso: float) -> float:
        """Standard deviation of dark pixels' numbers at an ISO, over time and pixels: sigma_d and DSNU together."""
        return self.gain_at(iso) * float(np.sqrt(self.dark_noise_at(iso)**2 + self.dsnu_e**2))


def _check(camera: Camera) -> None:
    def refuse(name: str, remedy: str, value: Any = None) -> None:
        raise CameraError(f"camera {camera.name}", name, getattr(camera, name) if value is None else value, remedy)

    for name in NUMBERS:
        if not _is_number(getattr(camera, name)):
            refuse(name, "expected a number")
    for name in (name for name in POSITIVE if not LEAST <= getattr(camera, name) <= MOST):
        refuse(name, f"expected a positive number, from {LEAST:g} to {MOST:g}")
    if not PITCH_LIMITS_UM[0] <= camera.pitch_um <= PITCH_LIMITS_UM[1]:
        refuse("pitch_um", "expected {:g} to {:g}".format(*PITCH_LIMITS_UM))
    for name in (name for name in NOT_NEGATIVE if not 0 <= getattr(camera, name) <= MOST):
        refuse(name, f"expected 0 or more, up to {MOST:g}")
    for name in (name for name in UP_TO_1 if getattr(camera, name) > 1):
        refuse(name, "expected at most 1")
    if len(camera.shape_px) != 2 or not all(isinstance(n, int) and 0 < n <= MOST_PX for n in camera.shape_px):
        refuse("shape_px", f"expected whole numbers of rows and columns, up to {MOST_PX}")
    if not isinstance(camera.bits, int) or not 1 <= camera.bits <= MOST_BITS:
        refuse("bits", f"expected 1 to {MOST_BITS}")
    if not camera.black_dn < camera.white_dn:
        refuse("black_dn", f"expected less than {camera.white_dn}, the highest number of {camera.bits} bits")
    _check_filters(camera, refuse)
    _check_efficiency(camera, refuse)


def _is_number(value):
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < np.inf


def _check_filters(camera, refuse):
    if not camera.channels or len(set(camera.channels)) != len(camera.channels):
        refuse("channels", "expected a different letter for each channel")
    if not all(len(row) == len(camera.filters[0]) for row in camera.filters):
        refuse("filters", "expected rows of the same length")
    if camera.filters and not 0 < max(len(camera.filters), len(camera.filters[0])) <= LARGEST_CELL:
        refuse("filters", f"expected at most {LARGEST_CELL} rows and columns")
    for letter in "".join(camera.filters):
        if letter not in camera.channels:
            refuse("filters", f"expected only {', '.join(camera.channels)}, the channels with a quantum efficiency",
                   letter)


def _check_efficiency(camera, refuse):
    nm, efficiency = camera.wavelengths_nm, camera.quantum_efficiency
    shortest, longest = WAVELENGTH_LIMITS_NM
    if nm.ndim != 1 or nm.size < 2 or not np.all(np.diff(nm) > 0) or not (shortest <= nm[0] and nm[-1] <= longest):
        refuse("wavelengths_nm", f"expected two or more ascending numbers from {shortest:g} to {longest:g}")
    if efficiency.shape != (len(camera.channels), nm.size):
        refuse("quantum_efficiency", f"expected {nm.size} numbers for each of {len(camera.channels)} channels",
               f"of shape {efficiency.shape}")
    if not np.all((efficiency >= 0) & (efficiency <= 1)):
        refuse("quantum_efficiency", "expected 0 to 1", float(efficiency.flat[np.argmax(~((efficiency >= 0) &
                                                                                        (efficiency <= 1)))]))
    for letter in (letter for letter, row in zip(camera.channels, efficiency, strict=True) if not row.any()):
        refuse("quantum_efficiency", "expected more than 0 at some wavelength", f"0 in all of {letter}")
