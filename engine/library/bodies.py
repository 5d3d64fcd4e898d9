"""Cameras by name or path."""

import tomllib
from dataclasses import dataclass
from functools import lru_cache
from os import PathLike
from pathlib import Path

from ..runtime.errors import CameraError
from ..sensor.camera import Camera
from ..sensor.camera_file import read_camera

CAMERAS = Path(__file__).resolve().parent / "cameras"
CameraSource = str | PathLike[str] | Camera
"""What a camera comes from: its name, its file, or the camera itself."""


@dataclass(frozen=True)
class DescribedCamera:
    """What a list of cameras shows of one.

    Attributes
    ----------
    title : str
    shape_px : (int, int)
        Rows and columns.
    size_mm : (float, float)
        Width and height of the sensor.
    """

    title: str
    shape_px: tuple[int, int]
    size_mm: tuple[float, float]


@lru_cache
def described_cameras() -> dict[str, DescribedCamera]:
    """The bundled cameras, by name, from the heads of their files: their sensitivities take much longer to read."""
    return {name: _described(name) for name in _names()}


def _described(name):
    head, *_ = (CAMERAS / f"{name}.toml").read_text(encoding="utf-8").partition("\n[")
    table = tomllib.loads(head)
    rows, columns = table["shape_px"]
    size_mm = columns * table["pitch_um"] * 1e-3, rows * table["pitch_um"] * 1e-3
    return DescribedCamera(table["title"], (rows, columns), size_mm)


@lru_cache
def bundled_cameras() -> dict[str, Camera]:
    """The bundled cameras, by name."""
    return {name: _bundled(name) for name in _names()}


def find_cameras(words: list[str]) -> dict[str, Camera]:
    """The bundled cameras that match every word in name, title or maker."""
    wanted = [word.casefold() for word in words]
    return {name: camera for name, camera in bundled_cameras().items()
            if all(word in f"{name} {camera.title} {camera.maker}".casefold() for word in wanted)}


def load_camera(source: CameraSource) -> Camera:
    """Load the camera with this name or in this file.

    Raises
    ------
    CameraError
        The camera is unknown, or its file is damaged.

    Examples
    --------
    >>> from lensfield import load_camera
    >>> camera = load_camera("sony-a7-iv")
    >>> camera.title, camera.shape_px, camera.pitch_um
    ('Sony Alpha 7 IV', (4672, 7008), 5.123)
    """
    if isinstance(source, Camera):
        return source
    name = str(source)
    if name in _names():
        return _bundled(name)
    if Path(name).suffix != ".toml" and not Path(name).exists():
        raise CameraError(name, "camera", "unknown", "expected a camera's file (.toml) or its name; `lensfield camera "
                                                     "list` lists the names")
    return read_camera(Path(name))


@lru_cache
def _names():
    return tuple(sorted(path.stem for path in CAMERAS.glob("*.toml")))


@lru_cache
def _bundled(name):
    return read_camera(CAMERAS / f"{name}.toml")
