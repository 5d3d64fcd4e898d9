"""Options of stray light: which parts are computed, and how clean the lens is."""

from dataclasses import dataclass

import numpy as np

from ..runtime.errors import InputError
from ..runtime.setting import check_choices, setting

AUTO, OFF = "auto", "off"
GHOSTS, VEIL, STAR = "ghosts", "veil", "star"
PARTS = {GHOSTS: ("Ghosts", "Light that two surfaces of the lens reflect"),
         VEIL: ("Veil", "Light that surfaces and the barrel scatter over the picture"),
         STAR: ("Star", "Light that the iris diffracts beyond the lens's PSFs")}
COARSE = 0.1  # the accuracy of Preview: from here on, stray light is off unless it is chosen


@dataclass(frozen=True)
class StrayOptions:
    """Which stray light is added to a lens image.

    Attributes
    ----------
    stray_light : str
        "auto", "off", or parts such as "ghosts,veil,star". "auto" computes a part if its predicted light exceeds the
        accuracy of the lens image: the share of the picture's light that may be misplaced.
    cleanliness : "new", "dusty" or "hazy"
        Condition of the lens's surfaces, whose scattered light is the veil.
    glare_index : float
        Veiling glare index (ISO 18844), in percent. 0: from `cleanliness`.
    neglected : float
        Largest share of the ghosts' light that may be left out: of weak sources and weak pairs of surfaces.

    Raises
    ------
    InputError
        If a value is invalid.

    Examples
    --------
    >>> from lensfield import StrayOptions
    >>> StrayOptions("ghosts,veil", cleanliness="dusty").listed
    ('ghosts', 'veil')
    """

    stray_light: str = setting(
        AUTO, name="Stray Light", option="stray", metavar="PARTS", panel="",
        text="Light that reaches the sensor by reflection, scatter or diffraction. Also accepts a list: "
             "ghosts,veil,star",
        choices={AUTO: ("As Needed", "The parts whose predicted light exceeds the accuracy of the lens image; none in "
                                     "Preview"),
                 OFF: ("Off", "None")})
    cleanliness: str = setting(
        "new", name="Cleanliness", panel="stray", text="Condition of the lens's surfaces, which determines the veil",
        choices={"new": ("New", "Polished and clean"), "dusty": ("Dusty", "Dust on the outer surfaces"),
                 "hazy": ("Hazy", "Haze and fine scratches, as in many old lenses")})
    glare_index: float = setting(
        0.0, name="Glare Index (%)", kind=float, metavar="PERCENT", limits=(0.0, 50.0), soft_limits=(0.0, 10.0),
        precision=2, panel="stray", unset="0",
        text="Veiling glare index (ISO 18844), in percent. 0: from Cleanliness")
    neglected: float = setting(
        0.01, name="Neglected", kind=float, option="neglected-ghosts", metavar="FRACTION", limits=(1e-4, 0.5),
        precision=3, subtype="FACTOR", panel="stray", unset="0.01",
        text="Largest share of the ghosts' light that may be left out: of weak sources and weak pairs of surfaces")

    def __post_init__(self) -> None:
        check_choices(self)
        if self.stray_light not in (AUTO, OFF):
            for part in self.listed:
                if part not in PARTS:
                    raise InputError("options", "stray", part or "empty",
                                     f"expected {AUTO}, {OFF}, or some of {', '.join(PARTS)}, separated by commas")
        for name, (least, most) in (("glare_index", (0, 50)), ("neglected", (0, 0.5))):
            value = getattr(self, name)
            if not (np.isfinite(value) and least <= value <= most):
                raise InputError("options", name, value, f"expected a number from {least} to {most}")

    @property
    def listed(self) -> tuple[str, ...]:
        """The parts that are chosen by name."""
        return () if self.stray_light in (AUTO, OFF) else tuple(self.stray_light.split(","))

    def parts(self, accuracy: float) -> tuple[str, ...]:
        """The parts to consider for a lens image of this accuracy."""
        if self.stray_light == AUTO:
            return tuple(PARTS) if accuracy < COARSE else ()
        return self.listed
