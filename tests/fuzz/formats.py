"""Every kind of untrusted file: valid samples, readers, and functions that damage files."""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import OpenEXR
from mutants import damaged, damaged_package

from lens_texts import SAMPLES
from lenses import gaussian_psf, make_lens
from lensfield.commands import filter
from lensfield.commands.reading import read_picture
from lensfield.engine.image.layers import Layer, LayeredRadiance
from lensfield.engine.image.pixel_grid import PixelGrid
from lensfield.engine.inspection.info import lens_info, lens_text
from lensfield.engine.lens_files import import_lens
from lensfield.engine.lens_files.package import package_bytes, read_package
from lensfield.engine.library.bodies import CAMERAS
from lensfield.engine.measured.files import read_measured
from lensfield.engine.pictures.spectral_exr import write_exr
from lensfield.engine.prescription.readers import ReadingOptions, read_prescription
from lensfield.engine.prescription.readers.toml import write_prescription
from lensfield.engine.sensor.camera_file import camera_text, read_camera
from lensfield.engine.sensor.film import read_film
from lensfield.engine.spectral import refraction, spectra
from lensfield.engine.spectral.refraction import load_refraction
from lensfield.engine.spectral.spectra import load_spectrum, parse_wavelengths
from measured_files import PLACES_PX, measured_files, options_for
from places import DATA, SHARED_DATA
from rgb_files import window
from vendor_files import EXPORTS, exported_lens

FIELD = ("angle_deg", 10.0)
SMALL_BYTES = 2**18  # of a valid file from another source: larger ones take longer and reveal nothing more
LENS = make_lens()


@dataclass(frozen=True)
class Sound:
    """A valid file, or several in a folder.

    Attributes
    ----------
    files : dict of bytes
        By name.
    entry : str
        The name of the file that is passed to the reader.
    """

    files: dict[str, bytes]
    entry: str


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Attributes
    ----------
    sounds : list of Sound
    read : function (path)
    damage : function (bytes, numpy.random.Generator)
    chatters : bool
        Whether a third-party library prints damage on standard error, which commands suppress.
    """

    sounds: list[Sound]
    read: Callable[[Path], object]
    damage: Callable[[bytes, np.random.Generator], bytes] = damaged
    chatters: bool = False


def formats(folder: Path) -> Iterator[tuple[str, Format]]:
    """(name, Format) of all kinds; valid files are written to a folder."""
    yield "lens package", Format(_packages(), read_full_package, damaged_package)
    yield from _imports(folder)
    yield from _measured(folder)
    yield from _prescriptions()
    for name, sounds in _pictures(folder).items():
        yield name, Format(sounds, read_as_filter_does, chatters=True)
    yield "spectrum (.spd)", Format(_texts(".spd", LIBRARY_SPECTRA), lambda path: load_spectrum(str(path)))
    yield "refraction (.yml)", Format(_texts(".yml", LIBRARY_GLASSES), lambda path: load_refraction(str(path)))
    yield "camera (.toml)", Format(_texts(".toml", LIBRARY_CAMERAS), _read_camera)
    yield "film (.toml)", Format(_texts(".toml", [DATA / "film.toml"]), read_film)
    yield "spectrum in a line", Format(_lines("400:0.1, 700:0.2", "[400 0.1 700 0.2]", "blackbody 5600", "~/x.spd"),
                                       _of_text(load_spectrum))
    yield "wavelengths", Format(_lines("400:700:31", "450, 550, 650.5"), _of_text(parse_wavelengths))


def _one(name, data):
    return Sound({name: data}, name)


def _of_folder(entry):
    return Sound({path.name: path.read_bytes() for path in entry.parent.iterdir()}, entry.name)


def _shared(pattern):
    """Small files from other sources, if available."""
    return [path for path in sorted(SHARED_DATA.glob(pattern)) if path.stat().st_size <= SMALL_BYTES]


# Lens data

def _packages():
    lenses = [make_lens(gaussian_psf(2, 3, 1.0, 9), source="a patent", notes="glass assumed: ½"), exported_lens()]
    return [_one("lens.npz", package_bytes(lens)) for lens in lenses]


def read_full_package(path):
    lens = read_package(path)
    return lens_text(lens_info(lens))


def _imports(folder):
    for name, write in EXPORTS.items():
        yield name, Format([_of_folder(write(folder / name, exported_lens()))], import_lens)


# Lenses as measured

def _measured(folder):
    for name, (file, contents) in measured_files(folder).items():
        yield f"measured: {name}", Format([_one(file, contents)], partial(_read_measured, name),
                                          chatters=file.endswith(".exr"))


def _read_measured(name, path):
    """Read the camera, and where light at a few places comes from; a lens would take longer than any file."""
    return read_measured(path, options_for(name), name).straight(PLACES_PX)


# Prescriptions

def _prescriptions():
    for name, text in SAMPLES.items():
        program, _, suffix = name.rpartition(".")
        yield (f"prescription of {program}" if program else f"prescription .{suffix}",
               _prescription(f".{suffix}", text, program.lower()))


def _prescription(kind, text, program=""):
    strangers = [path for path in _shared(f"**/*{kind}") if program in path.name.lower()]
    return Format([_one(f"lens{kind}", text.encode()), *(_one(path.name, path.read_bytes()) for path in strangers[:9])],
                  _read_prescription)


def _read_prescription(path):
    return write_prescription(read_prescription(path, ReadingOptions(FIELD)))


def _read_camera(path):
    return camera_text(read_camera(path))


# Pictures

def _pictures(folder):
    random = np.random.default_rng(1)
    planes = {name: random.random((18, 24), dtype=np.float32) for name in "RGBA"}
    flat = folder / "flat.exr"
    _write(flat, planes | {"ViewLayer.Depth.Z": 1 + planes["A"]}, compression=OpenEXR.ZIP_COMPRESSION)
    half = folder / "half.exr"
    _write(half, {f"beauty.{name}": plane.astype(np.float16) for name, plane in planes.items()},
           compression=OpenEXR.PIZ_COMPRESSION, displayWindow=window(-4, -4, 32, 26))
    deep = folder / "deep.exr"
    _write(deep, {name: _deep_plane(random) for name in "RGBAZ"}, type=OpenEXR.deepscanline,
           compression=OpenEXR.ZIPS_COMPRESSION)
    spectral = folder / "radiance.exr"
    write_exr(LAYERED.flat(), spectral, {"A": LAYERED.flat_alpha()}, LAYERED)
    return {"EXR in RGB": [_one("rgb.exr", path.read_bytes()) for path in (flat, half)],
            "deep EXR": [_one("deep.exr", deep.read_bytes())],
            "spectral EXR": [_one("radiance.exr", spectral.read_bytes())]}


def _write(path, planes, **header):
    with OpenEXR.File({"type": OpenEXR.scanlineimage} | header, planes) as file:
        file.write(str(path))


def _deep_plane(random):
    plane = np.empty((6, 8), dtype=object)
    for place in np.ndindex(plane.shape):
        plane[place] = random.random(2, dtype=np.float32)
    return plane


def _layered():
    grid = PixelGrid.around_frame((7, 10), 5.5, (2, 3))
    random = np.random.default_rng(2)

    def layer(shape, origin, depth_mm):
        alpha = random.random(shape, dtype=np.float32)
        return Layer(np.stack([alpha, alpha]), alpha, np.full(shape, depth_mm, np.float32), origin)

    return LayeredRadiance((layer((5, 6), (0, 0), 800.0), layer(grid.shape_px, (0, 0), np.inf)), (450.0, 600.0), grid,
                           49.5)


def _filter_options():
    """The arguments of `lensfield filter`, with its defaults."""
    parser = argparse.ArgumentParser()
    filter.add_options(parser)
    return parser.parse_args(["rgb.exr", "--lens", "any", "--output", "any.exr"])


LAYERED, FILTER_OPTIONS = _layered(), _filter_options()


def read_as_filter_does(path):
    return read_picture(path, FILTER_OPTIONS, LENS).depth


# Spectra

LIBRARY_SPECTRA = [next(folder.glob("*.spd")) for folder in spectra.LIBRARY.values()]
LIBRARY_CAMERAS = [CAMERAS / f"{name}.toml" for name in ("fujifilm-x-t4", "generic-three-chip")]
LIBRARY_GLASSES = sorted(refraction.LIBRARY.glob("*.yml"), key=lambda path: path.stat().st_size)[::20]


def _texts(kind, paths):
    return [_one(f"file{kind}", path.read_bytes()) for path in paths]


def _lines(*texts):
    return [_one("line.txt", text.encode()) for text in texts]


def _of_text(read):
    return partial(_read_line, read)


def _read_line(read, path):
    return read(path.read_text(encoding="utf-8", errors="replace"))
