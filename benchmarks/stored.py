"""The files of a render: their size, seconds and error by codec and precision."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image
from timing import least_s

from lensfield.engine.pictures.spectral_exr import channel_wavelength_nm, exr_threads, is_spectral, read_parts

LOSSLESS = {"none": OpenEXR.NO_COMPRESSION, "RLE": OpenEXR.RLE_COMPRESSION, "ZIPS": OpenEXR.ZIPS_COMPRESSION,
            "ZIP": OpenEXR.ZIP_COMPRESSION, "PIZ": OpenEXR.PIZ_COMPRESSION}
LOSSY = {"PXR24": OpenEXR.PXR24_COMPRESSION, "DWAA": OpenEXR.DWAA_COMPRESSION, "DWAB": OpenEXR.DWAB_COMPRESSION}
"""Codecs that every program reads. B44 has a fixed rate, and newer ones cannot be read by Blender 4.5."""
PRECISIONS = {"float": np.float32, "half": np.float16}
LEAST_HALF = 2.0**-14  # below, half precision has fewer digits
PNG_LEVELS = 0, 1, 3, 6, 9
BEST_OF = 3
DARK = 1e-3  # of the mean: light below this is not counted among errors


def files(folders=("build/noisy",)) -> Iterator[str]:
    """A frame's files by codec and precision: processor and wall-clock seconds to write and to read them, MB, errors.

        lensfield render sample_scenes/evening_chess.blend --wavelengths 400:700:12 --resolution 1920x1080 \\
            --samples 16 --denoise off --output build/noisy

    renders a noisy frame; without --samples and --denoise, a cleaner one. The errors are those of the light: the RMS
    and the greatest relative difference of values above a thousandth of their channel's mean. `tiny` is the share of
    light below half precision's normal numbers. The seconds for half precision include the conversion.
    """
    with tempfile.TemporaryDirectory() as temporary:
        for path in sorted(path for folder in folders for path in Path(folder).iterdir()):
            if path.suffix in (".exr", ".png"):
                yield str(path)
                yield (f"  {'':<15}{'written':>16}{'read':>16}\n  {'':<15}" + f"{'cpu s':>8}{'s':>8}" * 2
                       + f"{'MB':>9}{'RMS':>10}{'greatest':>10}")
                yield from (_png_rows if path.suffix == ".png" else _exr_rows)(path, Path(temporary) / path.name)


def _exr_rows(path, copy):
    """The rows of an EXR's parts, except for layers of depth."""
    for header, planes in read_parts(path):
        if not header.get("name", "").startswith("layer."):
            yield from _part_rows(header.get("name", ""), planes, is_spectral(path), copy)


def _part_rows(name, planes, spectral, copy):
    """The rows of a part, by precision and codec; of spectra, also with their lower half black."""
    light = [name for name in planes if channel_wavelength_nm(name) is not None or name in "RGBY"]
    tiny = np.mean([np.mean((plane != 0) & (np.abs(plane) < LEAST_HALF)) for plane in map(planes.get, light)])
    largest = max(np.abs(planes[name]).max() for name in light)
    yield f"  {name or 'picture'}: {len(planes)} channels; tiny: {tiny:.1%}; largest: {largest:.3g}"
    for precision in PRECISIONS:
        yield from _coded_rows(planes, light, precision, LOSSLESS | LOSSY, copy)
    if spectral:
        yield "  with its lower half black"
        yield from _coded_rows({name: np.where(np.arange(len(plane))[:, None] < len(plane) // 2, plane, 0)
                                for name, plane in planes.items()}, light, "float", LOSSLESS, copy)


def _coded_rows(planes, light, precision, codecs, copy):
    """The rows of planes in a precision, which applies to their light alone."""
    for name, codec in codecs.items():
        header = {"type": OpenEXR.scanlineimage, "compression": codec}

        def write(header=header):
            channels = planes | {each: planes[each].astype(PRECISIONS[precision]) for each in light}
            with exr_threads(), OpenEXR.File(header, channels) as file:
                file.write(str(copy))

        with np.errstate(over="ignore"):
            written = least_s(write, BEST_OF)
        read = least_s(lambda: read_parts(copy), BEST_OF)
        errors = "{:10.1e}{:10.1e}".format(*_errors(planes, light, copy))
        yield _row(f"{name}, {precision}", written, copy, read) + errors


def _errors(planes, light, copy):
    """The RMS and the greatest relative difference between planes and their copy in a file."""
    copied, differences = read_parts(copy)[0][1], []
    for name in light:
        bright = np.abs(planes[name]) > DARK * np.abs(planes[name]).mean()
        differences.append((copied[name][bright] / planes[name][bright] - 1).astype(float))
    differences = np.concatenate(differences)
    return np.sqrt(np.mean(differences**2)), np.abs(differences).max()


def _png_rows(path, copy):
    """The rows of a PNG, by level of compression."""
    picture = Image.open(path)
    picture.load()
    for level in PNG_LEVELS:
        written = least_s(lambda level=level: picture.save(copy, compress_level=level), BEST_OF)
        yield _row(f"PNG, level {level}", written, copy, least_s(lambda: Image.open(copy).load(), BEST_OF))


def _row(what, written, path, read):
    return (f"  {what:<15}{written[0]:8.2f}{written[1]:8.2f}{read[0]:8.2f}{read[1]:8.2f}"
            f"{path.stat().st_size / 1e6:9.2f}")
