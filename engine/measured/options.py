"""What the user states about a measured lens, in addition to its file."""

from dataclasses import dataclass

import numpy as np

from ..runtime.errors import InputError, LensError
from ..runtime.numbers import is_positive

NEEDED = "measured lens"
LEAST_F_NUMBER, MOST_F_NUMBER = 0.5, 256.0


@dataclass(frozen=True)
class MeasuredOptions:
    """Options of the reading of a file.

    Attributes
    ----------
    which : str or None
        The lens or camera, if the file has several.
    size_px : (int, int) or None
        Columns and rows of the picture, if the file does not state them.
    focal_mm : float or None
        Focal length: of an STMap, and of a zoom lens in Lensfun's database.
    sensor_mm : (float, float) or None
        Width and height of the sensor that the picture fits in.
    f_number : float
    focus_mm : float
        Distance to the plane of focus; inf for infinity.
    overscan : float
        Of STMaps: width of the undistorted picture relative to the lens's picture, with one middle.

    Raises
    ------
    InputError
        A number is not positive, or outside its range.
    """

    which: str | None = None
    size_px: tuple[int, int] | None = None
    focal_mm: float | None = None
    sensor_mm: tuple[float, float] | None = None
    f_number: float = 8.0
    focus_mm: float = np.inf
    overscan: float = 1.0

    def __post_init__(self) -> None:
        if self.focal_mm is not None and not is_positive(self.focal_mm):
            raise InputError("options", "--focal-length", self.focal_mm, "expected a positive number")
        if not LEAST_F_NUMBER <= self.f_number <= MOST_F_NUMBER:
            raise InputError("options", "--f-number", self.f_number,
                             f"expected {LEAST_F_NUMBER:g} to {MOST_F_NUMBER:g}")
        if not self.focus_mm > 0:
            raise InputError("options", "--focus", self.focus_mm, "expected a positive distance")
        if not 1 <= self.overscan <= 10:
            raise InputError("options", "--overscan", self.overscan, "expected 1 to 10")

    def check_taken(self, takes: tuple[str, ...], kind: str) -> None:
        """Raise an InputError for a name, a focal length or an overscan that a kind of file does not take."""
        for field, option, default in (("which", "--which", None), ("focal_mm", "--focal-length", None),
                                       ("overscan", "--overscan", 1.0)):
            if getattr(self, field) != default and field not in takes:
                raise InputError("options", option, getattr(self, field), f"leave it out: --as {kind} does not take it")

    def check_size(self, size_px: tuple[int, int]) -> None:
        """Raise an InputError if the file's pictures have another size than stated."""
        if self.size_px not in (None, size_px):
            raise InputError("options", "--resolution", "{}x{}".format(*self.size_px),
                             "leave it out: the file is for pictures of {}x{}".format(*size_px))

    def chosen(self, path: object, names: list[str], what: str) -> str:
        """The name among a file's that `which` states; the only one by default.

        Raises
        ------
        LensError
            None is stated of several, or the stated one does not exist.
        """
        if self.which is None and len(names) == 1:
            return names[0]
        if self.which not in names:
            value = f"one of {len(names)}" if self.which is None else self.which
            raise LensError(path, what, value, f"name it with --which: {', '.join(names[:12]) or 'the file has none'}")
        return self.which
