"""COLMAP's cameras.txt: https://colmap.github.io/cameras.html. The middle of the upper left pixel is at 0.5, 0.5."""

from pathlib import Path
from typing import NamedTuple

from ..calibration.models import KANNALA_BRANDT, PINHOLE, RADIAL, RADTAN, RATIONAL, Model
from ..runtime.errors import LensError
from ..runtime.text import read_text
from .camera import ModelledCamera
from .options import MeasuredOptions


class Kind(NamedTuple):
    """A model of COLMAP: ours, whether fx and fy differ, and the number of coefficients; others are 0."""

    model: Model
    two_focals: bool
    coefficients: int


KINDS = {
    "SIMPLE_PINHOLE": Kind(PINHOLE, False, 0), "PINHOLE": Kind(PINHOLE, True, 0),
    "SIMPLE_RADIAL": Kind(RADIAL[0], False, 1), "RADIAL": Kind(RADIAL[1], False, 2), "OPENCV": Kind(RADTAN, True, 4),
    "FULL_OPENCV": Kind(RATIONAL, True, 8), "OPENCV_FISHEYE": Kind(KANNALA_BRANDT, True, 4),
    "SIMPLE_RADIAL_FISHEYE": Kind(KANNALA_BRANDT, False, 1), "RADIAL_FISHEYE": Kind(KANNALA_BRANDT, False, 2)}
MOST_CAMERAS = 100_000


def read_colmap(path: Path, options: MeasuredOptions) -> ModelledCamera:
    """A camera in COLMAP's cameras.txt, by its CAMERA_ID if there are several."""
    if path.suffix.lower() == ".bin":
        raise LensError(path, "kind of file", ".bin", "convert it: colmap model_converter --output_type TXT")
    lines = [line.split() for line in read_text(path).splitlines() if line.strip() and not line.startswith("#")]
    cameras = {words[0]: words for words in lines[:MOST_CAMERAS]}
    chosen = options.chosen(path, list(cameras), "camera")
    kind, values = cameras[chosen][1:2], cameras[chosen][2:]
    if not kind or kind[0] not in KINDS:
        raise LensError(path, f"camera {chosen}, MODEL", kind[0] if kind else "missing", f"expected {', '.join(KINDS)}")
    model, two_focals, count = KINDS[kind[0]]
    expected = 2 + 3 + two_focals + count
    try:
        width, height, *params = map(float, values)
        if len(values) != expected or width != int(width) or height != int(height):
            raise ValueError
    except (ValueError, OverflowError):
        raise LensError(path, f"camera {chosen}", " ".join(values),
                        f"expected WIDTH, HEIGHT and {expected - 2} PARAMS for {kind[0]}") from None
    focals, (cx, cy, *coefficients) = params[:1 + two_focals], params[1 + two_focals:]
    coefficients += [0.0] * (len(model.coefficients) - count)
    return ModelledCamera(f"{path.stem}-{chosen}" if len(cameras) > 1 else path.stem, f"COLMAP: {kind[0]}",
                          (int(width), int(height)), (focals[0], focals[-1]), (cx - 0.5, cy - 0.5), model,
                          tuple(coefficients))
