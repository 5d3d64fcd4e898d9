"""Raw files in converters: the colours of a chart, and what the files' opcodes correct of lenses.

    python validation/raw_files.py [PAGE.md]

writes the 24-patch chart under D65, through cameras, as DNG, and develops it by LibRaw and by the converters in
tests/support/converters.py that are installed. It prints the median and the largest CIEDE2000 from the chart's own
colours; and of lenses the distortion and falloff at the corner, and what the polynomials leave of them anywhere; and
the processor seconds of writing and developing 12 megapixels. The tables are written into the page, below the heading
"Raw files". The exit status is 1 if a median exceeds 2.
"""

import re
import sys
import tempfile
from pathlib import Path
from time import process_time

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from converters import CONVERTERS, installed  # noqa: E402
from lensfield.engine import load_lens  # noqa: E402
from lensfield.engine.field.field_map import field_map  # noqa: E402
from lensfield.engine.field.lens_correction import lens_correction  # noqa: E402
from lensfield.engine.image.pixel_grid import PixelGrid  # noqa: E402
from lensfield.engine.library.bodies import load_camera  # noqa: E402
from lensfield.engine.pictures.develop import developed  # noqa: E402
from lensfield.engine.pictures.dng import write_dng  # noqa: E402
from lensfield.engine.sensor.colour import channel_weights  # noqa: E402
from lensfield.engine.sensor.exposure import Exposure, RawImage, channels_of  # noqa: E402
from lensfield.engine.spectral.colour import REC709_TO_XYZ  # noqa: E402
from raw_pictures import NM, chart_error, chart_raw, small_camera  # noqa: E402

CAMERAS = "sony-a7-iv", "canon-eos-5d-iv", "fujifilm-x-t4", "nikon-d850", "generic-phone"
LENSES = "edmund-54852", "apple-phone-4mm", "kodak-petzval-100mm", "nikkor-58mm-f1.4", "zeiss-hologon-15mm", \
    "olympus-fisheye-8mm"
LARGEST_MEDIAN = 2.0
COLUMNS_PX = 1200
CHART_TABLE = re.compile(r"(?<=\n)\| camera \| LibRaw.*?(?=\n\n)", re.DOTALL)
LENS_TABLE = re.compile(r"(?<=\n)\| lens \| distortion.*?(?=\n\n)", re.DOTALL)


def chart_errors(name):
    """CIEDE2000 of the chart's patches, by converter, through a camera of the library with its own filters."""
    camera = small_camera(name, load_camera(name).filters)
    raw = chart_raw(camera)
    errors = {"LibRaw": chart_error(developed(raw) @ REC709_TO_XYZ.T)}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_dng(raw, folder / "a.dng")
        for converter, develop in CONVERTERS.items():
            if installed(converter):
                errors[converter] = chart_error(develop(folder) @ REC709_TO_XYZ.T)
    return errors


def lens_row(name):
    """Cells of a lens: its name, distortion and falloff at the corner of its sensor, and what is left of them."""
    lens, camera = load_lens(name, quality="preview"), load_camera("sony-a7-iv")
    width_mm, height_mm = lens.sensor_mm
    frame = PixelGrid((round(COLUMNS_PX * height_mm / width_mm), COLUMNS_PX), 1e3 * width_mm / COLUMNS_PX)
    correction = lens_correction(lens, frame, NM, channel_weights(camera, NM))
    corner_mm = np.array([np.hypot(width_mm, height_mm) / 2])
    field = field_map(lens).at_wavelength(float(lens.nearest_nm(lens.reference_wavelength_nm)))
    falloff = 1 - float(field.relative_illumination(corner_mm, np.zeros(1))[0])
    return [name, f"{correction.distortion:.2%}",
            "not corrected" if correction.warp is None else f"{correction.distortion_error:.3%}", f"{falloff:.0%}",
            "not corrected" if correction.gain is None else f"{correction.gain_error:.1%}"]


def cost():
    """A line with the processor seconds of a picture of 12 megapixels."""
    camera = small_camera(shape_px=(3000, 4000))
    numbers = np.random.default_rng(1).integers(500, 15000, camera.shape_px).astype(np.uint16)
    raw = RawImage(numbers, channels_of(camera, camera.shape_px), camera, Exposure(1 / 60, 100.0), None)
    with tempfile.TemporaryDirectory() as temporary:
        write_s = seconds(lambda: write_dng(raw, Path(temporary, "a.dng")))
    return f"12 megapixels: {write_s:.2f} s to write, {seconds(lambda: developed(raw)):.1f} s to develop"


def seconds(work):
    """Processor seconds that a function takes."""
    start = process_time()
    work()
    return process_time() - start


def markdown(rows):
    head, *body = rows
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *body))


def chart_row(title, errors):
    return [title, *(f"{np.median(each):.2f}, {each.max():.1f}" for each in errors.values())]


def main(arguments):
    errors = {load_camera(name).title: chart_errors(name) for name in CAMERAS}
    charts = markdown([["camera", *next(iter(errors.values()))], *(chart_row(*each) for each in errors.items())])
    lenses = markdown([["lens", "distortion", "left", "falloff", "left"], *map(lens_row, LENSES)])
    print(charts, lenses, cost(), sep="\n\n")
    if arguments and not all(map(installed, CONVERTERS)):
        sys.exit(f"lensfield: {arguments[0]} is not changed: install {' and '.join(CONVERTERS)}")
    if arguments:
        page = Path(arguments[0])
        text = CHART_TABLE.sub(lambda _: charts, page.read_text(encoding="utf-8"))
        page.write_text(LENS_TABLE.sub(lambda _: lenses, text), encoding="utf-8")
    return int(any(np.median(each) > LARGEST_MEDIAN for found in errors.values() for each in found.values()))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
