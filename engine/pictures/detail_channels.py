"""The channels of a `Detail` in a spectral EXR.

`detail.550,000000nm.12` has the shares, at this wavelength, of the part in row 1 and column 2 of each pixel.
"""

import re
from collections.abc import Mapping

import numpy as np

from ..image.detail import Detail
from ..runtime.errors import ImageError

CHANNEL = re.compile(r"^detail\.(\d+,\d+)nm\.([1-9])([1-9])$")


def detail_planes(detail: Detail | None) -> dict[str, np.ndarray]:
    """The channels of a Detail, in half precision, by name; none without one."""
    if detail is None:
        return {}
    times = detail.times
    return {"detail.{}nm.{}{}".format(f"{nm:.6f}".replace(".", ","), down + 1, across + 1):
            shares[down::times, across::times]
            for nm, shares in zip(detail.wavelengths_nm, detail.shares, strict=True)
            for down, across in np.ndindex(times, times)}


def is_detail(name: str) -> bool:
    """Whether a channel is part of a Detail."""
    return bool(CHANNEL.match(name))


def detail_of(channels: Mapping[str, np.ndarray], path: object) -> Detail | None:
    """The Detail in some channels, None without one; an ImageError if it is incomplete or invalid."""
    matches = [match for name in channels if (match := CHANNEL.match(name))]
    if not matches:
        return None
    parts = {(float(match[1].replace(",", ".")), int(match[2]), int(match[3])): channels[match[0]] for match in matches}
    wavelengths_nm = sorted({nm for nm, _, _ in parts})
    rows, columns = sorted({row for _, row, _ in parts}), sorted({column for _, _, column in parts})
    times = len(rows)
    if not rows == columns == list(range(1, times + 1)) or len(parts) != len(wavelengths_nm) * times**2:
        raise ImageError(path, "detail", f"{len(parts)} channels", "expected all parts of a pixel at each wavelength")
    first = next(iter(parts.values()))
    shares = np.empty((len(wavelengths_nm), *(times * n for n in first.shape)), np.float16)
    with np.errstate(over="ignore"):  # infinities are refused
        for (nm, row, column), plane in parts.items():
            shares[wavelengths_nm.index(nm), row - 1::times, column - 1::times] = plane
    return Detail(np.array(wavelengths_nm), shares, times)
