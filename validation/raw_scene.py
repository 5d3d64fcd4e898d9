"""The sample scene in raw files of three cameras, judged by raw converters, Adobe's DNG SDK and the files' own noise.

    python validation/raw_scene.py IRRADIANCE.exr FOLDER [PAGE.md]

takes pictures of the scene's lens image, and writes them to the folder as DNG. LibRaw must read every pixel back, and
Adobe's SDK accept the files. LibRaw and the installed converters of tests/support/converters.py develop them, into PNGs
in the folder. The command prints the colour differences of their pictures from `developed`, those of the chart from the
lens image itself, and the noise of two copies of the camera over the file's NoiseProfile. The exit status is 1 if a
figure is outside its limits. The table in the page is replaced.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import rawpy
from scipy.ndimage import map_coordinates

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from converters import CONVERTERS, installed  # noqa: E402
from dng_fields import fields  # noqa: E402
from lensfield.engine import load_camera, photograph  # noqa: E402
from lensfield.engine.photo.photograph import shutter_text  # noqa: E402
from lensfield.engine.photo.raw_file import write_raw_file  # noqa: E402
from lensfield.engine.pictures.develop import developed  # noqa: E402
from lensfield.engine.pictures.dng import dng_samples  # noqa: E402
from lensfield.engine.pictures.preview import to_rec709, write_png  # noqa: E402
from lensfield.engine.pictures.spectral_exr import read_exr  # noqa: E402
from lensfield.engine.sensor.colour import filter_channels  # noqa: E402
from lensfield.engine.sensor.resampling import pixel_means  # noqa: E402
from lensfield.engine.spectral.colour import REC709_TO_XYZ  # noqa: E402
from lensfield.engine.spectral.colour_difference import ciede2000, lab_from_xyz  # noqa: E402
from raw_pictures import GREYS, chart_xyz  # noqa: E402

CAMERAS = "generic-phone", "fujifilm-x-t4", "sony-a7-iv"
CHART = np.array([[[0.519, 0.639], [0.528, 0.821]], [[0.664, 0.635], [0.673, 0.816]]])
"""Centres of the chart's corner patches in the sample scene, as shares of the rows and the columns."""
PATCH = 0.4  # share of a patch's side that is measured
BLOCK_PX, EDGE = 4, 2  # pixels of the lens image to a side of the blocks compared; blocks at the edge left out
SATURATING = 0.9
PICTURE_LIMIT, CHART_LIMIT = 0.5, 2.0  # median CIEDE2000
LIGHTS = {"dark": (-1.0, 0.05), "light": (0.05, 0.7)}
"""Signals, relative to saturation, over which noise is averaged."""
SIGMAS = 5
BLACK, WHITE, NOISE_PROFILE = 50714, 50717, 51041
ADOBE = "import dngpy, sys; dngpy.Dng(sys.argv[1]).raw_pixels"
TABLE = re.compile(r"(### The sample scene\n.*?\n)(\|.*?)(?=\n\n)", re.DOTALL)


@dataclass(frozen=True)
class Figure:
    """A figure of a raw file, and its limits."""

    name: str
    value: float
    low: float
    high: float

    @property
    def missed(self):
        return not self.low <= self.value <= self.high

    def __str__(self):
        return (f"  {self.name:20} {self.value:.3f}   limits {self.low:.3f} to {self.high:.3f}   "
                f"{'MISSED' if self.missed else 'met'}")

    @property
    def cell(self):
        return f"**{self.value:.3f}**<br>{self.low:.3f} to {self.high:.3f}"


def libraw(folder, name="a.dng"):
    """A file in a folder, developed with LibRaw's own colours: linear Rec. 709 (row, column, 3)."""
    with rawpy.imread(str(folder / name)) as file:
        return file.postprocess(use_camera_wb=True, no_auto_bright=True, gamma=(1, 1), output_bps=16) / 65535


def judged(irradiance, chart, camera, folder):
    """The raw picture of a lens image, whose files are written to a folder, and its figures."""
    raw, second = (photograph(irradiance, camera, serial=serial) for serial in (0, 1))
    for each, name in ((raw, "a.dng"), (second, "b.dng")):
        write_raw_file(each, irradiance, folder / name)
    check_pixels(raw, folder / "a.dng")
    pictures = {"developed": developed(raw)} | developed_by_others(folder / "a.dng")
    for name, picture in pictures.items():
        write_png(np.asarray(picture, np.float32), folder / f"{name}.png", 1.0)
    return raw, [*picture_figures(pictures, irradiance, raw.camera),
                 *chart_figures(pictures, irradiance, chart, raw.camera),
                 *noise_figures(folder / "a.dng", folder / "b.dng", raw)]


def developed_by_others(path):
    """The pictures of a file by the programs that are installed here, each in linear Rec. 709, by program.

    They work on a copy, because darktable remembers files and does not replace its pictures.
    """
    programs = {"LibRaw": libraw} | {name: develop for name, develop in CONVERTERS.items() if installed(name)}
    with tempfile.TemporaryDirectory() as temporary:
        shutil.copy(path, Path(temporary, "a.dng"))
        return {name: develop(Path(temporary)) for name, develop in programs.items()}


def check_pixels(raw, path):
    """Stop unless LibRaw reads every pixel of a raw picture from its file."""
    with rawpy.imread(str(path)) as file:
        np.testing.assert_array_equal(file.raw_image, dng_samples(raw))


def adobe_warnings(path):
    """What Adobe's SDK prints about a file that violates the specification; it is in dngpy."""
    result = subprocess.run([sys.executable, "-c", ADOBE, str(path)], capture_output=True, text=True)
    return result.stdout + result.stderr


def picture_figures(pictures, irradiance, camera):
    """Median CIEDE2000 of other programs' pictures from `developed`, over blocks of the scene that do not saturate.

    The pictures have their own colours, for which white is D65; only their exposure is equalised.
    """
    rows, columns = (n // BLOCK_PX for n in irradiance.frame_px)
    inside = slice(EDGE, rows - EDGE), slice(EDGE, columns - EDGE)
    blocks = {name: resampled(picture, camera.pitch_um, (rows, columns), BLOCK_PX * irradiance.pitch_um)[inside]
              for name, picture in pictures.items()}
    chosen = blocks["developed"].max(axis=-1) < SATURATING
    reference, *others = (each[chosen] @ REC709_TO_XYZ.T for each in blocks.values())
    white = REC709_TO_XYZ.sum(axis=1)
    for name, other in zip([*blocks][1:], others, strict=True):
        exposure = np.median(reference[:, 1] / other[:, 1])
        errors = ciede2000(lab_from_xyz(exposure * other, white), lab_from_xyz(reference, white))
        yield Figure(f"{name}, picture", float(np.median(errors)), 0.0, PICTURE_LIMIT)


def chart_figures(pictures, irradiance, chart, camera):
    """Median CIEDE2000 of the chart in pictures from the chart in the lens image.

    The scene's light is not D65. White is therefore what the chart's greys show of it, in each picture.
    """
    truth = chart_lab(to_rec709(irradiance.frame()), chart)
    for name, picture in pictures.items():
        shown = resampled(picture, camera.pitch_um, irradiance.frame_px, irradiance.pitch_um)
        yield Figure(f"{name}, chart", float(np.median(ciede2000(chart_lab(shown, chart), truth))), 0.0, CHART_LIMIT)


def chart_lab(rec709, chart):
    """CIELAB of the chart's 24 patches, relative to the light on its greys."""
    row, column = np.meshgrid(np.arange(4) / 3, np.arange(6) / 5, indexing="ij")
    steps = np.linspace(-PATCH / 2, PATCH / 2, 7)
    row, column = row[..., None, None] + steps[:, None] / 3, column[..., None, None] + steps / 5
    upper, lower = (left + column[..., None] * (right - left) for left, right in chart)
    places = (upper + row[..., None] * (lower - upper)) * rec709.shape[:2] - 0.5
    samples = [map_coordinates(plane, np.moveaxis(places, -1, 0), order=1) for plane in np.moveaxis(rec709, -1, 0)]
    xyz = np.mean(samples, axis=(-2, -1)).reshape(3, 24).T @ REC709_TO_XYZ.T
    return lab_from_xyz(xyz, xyz[GREYS].sum(axis=0) / chart_xyz()[0][GREYS, 1].sum())


def resampled(picture, pitch_um, shape_px, wanted_um):
    """A picture (row, column, 3) in other pixels with the same middle."""
    return np.stack([pixel_means(plane, pitch_um, shape_px, wanted_um) for plane in np.moveaxis(picture, -1, 0)], -1)


def noise_figures(path, second, raw):
    """Variance between two copies of a camera over the variance S x + O of their files, by channel and light.

    The copies differ in DSNU, which O contains, and in PRNU, which it cannot contain: (PRNU x)^2 is added. Pixels with
    the expected variances v give the ratio with the standard deviation sqrt(2 sum v^2) / sum v.
    """
    tags, _ = fields(path)
    slope, constant = np.unique(np.reshape(tags[NOISE_PROFILE], (-1, 2)), axis=0)[0]
    signals = [(numbers(each) - tags[BLACK]) / (tags[WHITE] - tags[BLACK]) for each in (path, second)]
    mean, variance = sum(signals) / 2, np.subtract(*signals)**2 / 2
    expected = slope * mean + constant + (raw.camera.prnu * mean)**2
    for letter in filter_channels(raw.camera):
        for light, (low, high) in LIGHTS.items():
            chosen = (raw.channel == raw.camera.channels.index(letter)) & (mean >= low) & (mean < high)
            sigma = np.sqrt(2 * (expected[chosen]**2).sum()) / expected[chosen].sum()
            yield Figure(f"noise of {letter}, {light}", float(variance[chosen].sum() / expected[chosen].sum()),
                         1 - SIGMAS * sigma, 1 + SIGMAS * sigma)


def numbers(path):
    """The digital numbers of a file, as LibRaw reads them."""
    with rawpy.imread(str(path)) as file:
        return file.raw_image.astype(np.float64)


def table(measured):
    """Markdown of the figures: a row for each figure, a column for each camera."""
    names = [figure.name for figure in next(iter(measured.values()))[1]]
    rows = [["", *(raw.camera.title for raw, _ in measured.values())], ["---"] * (len(measured) + 1),
            ["picture", *(taken(raw) for raw, _ in measured.values())],
            *([name, *(figures[index].cell for _, figures in measured.values())] for index, name in enumerate(names))]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def taken(raw):
    """A raw picture's size and exposure."""
    rows, columns = raw.numbers.shape
    return f"{columns} x {rows} px, {shutter_text(raw.exposure.shutter_s)} at ISO {raw.exposure.iso:.0f}"


def absent():
    """The judges that are not installed here."""
    return [name for name in CONVERTERS if not installed(name)] + ["dngpy"] * (find_spec("dngpy") is None)


def main(path, folder, page=None):
    if page and absent():
        sys.exit(f"lensfield: {page} is not changed: install {' and '.join(absent())}")
    irradiance, measured, warnings = read_exr(path), {}, ""
    for name in CAMERAS:
        place = Path(folder).resolve() / name
        place.mkdir(parents=True, exist_ok=True)
        measured[name] = raw, figures = judged(irradiance, CHART, load_camera(name), place)
        warnings += "" if "dngpy" in absent() else adobe_warnings(place / "a.dng")
        print(f"\n{raw.camera.title}: {taken(raw)}")
        print(*figures, sep="\n", flush=True)
    if absent():
        print(f"\nnot installed: {', '.join(absent())}")
    if warnings:
        print(f"\nAdobe's DNG SDK: {warnings}")
    if page:
        text = TABLE.sub(lambda match: match[1] + table(measured), Path(page).read_text(encoding="utf-8"))
        Path(page).write_text(text, encoding="utf-8")
    return int(bool(warnings) or any(figure.missed for _, figures in measured.values() for figure in figures))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
