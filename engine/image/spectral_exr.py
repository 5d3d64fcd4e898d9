"""Spectral EXR files: the layout of Fichet, Pacanowski and Wilkie, JCGT 2021, version 1.0.

One FLOAT channel per wavelength, `S0.550,000000nm`, beside R, G and B for programs that know no spectra. Overscan is
what OpenEXR means it to be: a data window larger than the display window. Layers of radiance are further parts of the
file, `layer.1` and on, near to far: whoever reads the first has the picture that a pinhole sees.
"""

import math
import os
import re
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial

import numpy as np
import OpenEXR

from ..errors import ImageError, absence, printable
from ..files import MARK, AnyPath, atomic_path
from ..memory import check_room
from ..scratch import is_large, let_go, new_array
from ..threads import thread_count
from .depth_range import BACKGROUND_MM
from .layers import Layer, LayeredRadiance
from .pixel_grid import PLANE, PROJECTIONS
from .preview import to_rec709
from .spectral_image import RADIANCE, UNITS, SpectralImage

CHANNEL = re.compile(r"^(?:S0|T)\.(\d*,?\d*(?:[Ee][+-]?\d+)?)(Y|Z|E|P|T|G|M|k|h|da|d|c|m|u|n|p)?(m|Hz)$")
PREFIX = dict(Y=1e24, Z=1e21, E=1e18, P=1e15, T=1e12, G=1e9, M=1e6, k=1e3, h=1e2, da=1e1,
              d=1e-1, c=1e-2, m=1e-3, u=1e-6, n=1e-9, p=1e-12)
# By benchmarks/file_figures.py: most digits of a spectral plane are noise, even where Cycles has denoised, so that ZIP
# takes off 10 to 17 % in six times the seconds; run lengths take off what is black. Off plain pictures ZIP takes more.
SPECTRAL_COMPRESSION, PLAIN_COMPRESSION = OpenEXR.RLE_COMPRESSION, OpenEXR.ZIP_COMPRESSION
SPEED_OF_LIGHT_M_S = 299792458.0
LAYOUT_VERSION = "1.0"
EMISSIVE_UNITS = "W.m^-2.sr^-1"  # the layout's canonical string; its values are densities per nm
FIRST_PART, LAYER_PART = "radiance", "layer."
SAMPLE_BYTES, DEEP_BYTES = 4, 128  # of a pixel's channel, as a number or as an array of its own
EMPTY_PX, MOST_EMPTY = 2**25, 64  # a display window of more pixels may not be as many times as large as its data
M_TO_MM = 1e3
TYPES = {"HALF": np.float16, "FLOAT": np.float32, "UINT": np.uint32}
READ_BY_ROWS = OpenEXR.scanlineimage, OpenEXR.tiledimage
BLOCK_ROWS = 64  # read at once: a multiple of what the chunks of most compressions hold


def channel_name(wavelength_nm: float) -> str:
    """Channel of an emissive wavelength, with the layout's decimal comma."""
    return f"S0.{wavelength_nm:.6f}nm".replace(".", ",").replace("S0,", "S0.", 1)


def write_exr(image: SpectralImage, path: str | os.PathLike, beside: dict[str, np.ndarray] | None = None,
              layered: LayeredRadiance | None = None) -> None:
    """Write a spectral image, whole or not at all; and beside it planes such as A, alpha, and Z, depth, by channel; and
    the layers that it is seen in, if there are any, each with its own A and Z, in metres.

    Radiance carries the layout's `emissiveUnits`; irradiance, for which the layout has no unit, does not. Both carry
    `lensfield:` attributes: quantity, units, pitchUm, and centrePx, the row and the column, in this order and in the
    pixel coordinates of the windows, where the optical axis meets the picture; captured radiance focalMm, fisheye
    radiance projection too, irradiance lens and fNumberEffective. Where R, G and B are exposed, exposure tells by what
    factor; the spectral channels never are.
    """
    planes = _spectral_planes(image.cube, image.wavelengths_nm, path) | _rgb_planes(to_rec709(image)) | (beside or {})
    _write([(_header(image), planes), *(_layer_parts(layered, path) if layered else ())], path)
    for cube in (image.cube, *(layer.cube for layer in (layered.layers if layered else ()))):
        let_go(cube)


def _spectral_planes(cube, wavelengths_nm, path):
    planes = {channel_name(nm): plane for nm, plane in zip(wavelengths_nm, cube, strict=True)}
    if len(planes) < len(wavelengths_nm):
        raise ImageError(path, "wavelengths_nm", np.asarray(wavelengths_nm).tolist(),
                         "channel names tell a millionth of a nanometre apart, no less")
    return planes


def _layer_parts(layered, path):
    """(header, planes) of each layer."""
    above, left = layered.grid.overscan_px
    for layer in layered.layers:
        origin = layer.origin_px[0] - above, layer.origin_px[1] - left
        depth_m = np.where(layer.depth_mm < BACKGROUND_MM, layer.depth_mm, BACKGROUND_MM) / np.float32(M_TO_MM)
        yield (_windows(layered.grid.frame_px, origin, layer.alpha.shape),
               _spectral_planes(layer.cube, layered.wavelengths_nm, path) | {"A": layer.alpha, "Z": depth_m})


def _windows(frame_px, origin_px, shape_px):
    """How each part of a spectral file is laid out, the frame's first pixel being the origin of all."""
    return {"compression": SPECTRAL_COMPRESSION, "type": OpenEXR.scanlineimage,
            "displayWindow": _box((0, 0), frame_px), "dataWindow": _box(origin_px, shape_px)}


def _header(image):
    top, left = image.overscan_px
    header = _windows(image.frame_px, (-top, -left), image.cube.shape[1:]) | {
        "spectralLayoutVersion": LAYOUT_VERSION,
        "lensfield:quantity": image.quantity, "lensfield:units": UNITS[image.quantity],
        "lensfield:pitchUm": np.array([image.pitch_um]),  # an array keeps its doubles, a float would not
        "lensfield:centrePx": np.array([image.centre_px[0] - top, image.centre_px[1] - left]),
    }
    if image.quantity == RADIANCE:
        header["emissiveUnits"] = EMISSIVE_UNITS
        if image.projection != PLANE:
            header["lensfield:projection"] = image.projection
    if image.focal_mm:
        header["lensfield:focalMm"] = np.array([float(image.focal_mm)])
    if image.exposure != 1:
        header["lensfield:exposure"] = np.array([image.exposure])
    if image.lens_name:
        header["lensfield:lens"] = image.lens_name
    if image.f_number_effective:
        header["lensfield:fNumberEffective"] = np.array([float(image.f_number_effective)])
    return header


def write_rgb_exr(rec709: np.ndarray, path: str | os.PathLike, alpha: np.ndarray | None = None) -> None:
    """Write a linear Rec. 709 picture (row, column, 3) as a plain EXR, for programs that take a spectral file's
    channels for layers, as Blender does; with the alpha that it is premultiplied by. Whole or not at all."""
    _write_plain(_rgb_planes(rec709) | ({} if alpha is None else {"A": alpha}), path)


def write_plane_exr(plane: np.ndarray, path: str | os.PathLike) -> None:
    """Write numbers (row, column) as a plain EXR of the one channel Y. Whole or not at all."""
    _write_plain({"Y": plane}, path)


def _write_plain(planes, path):
    header = {"compression": PLAIN_COMPRESSION, "type": OpenEXR.scanlineimage}
    _write([(header, planes)], path)


def _write(parts, path):
    parts[0][0]["software"] = MARK
    names = [FIRST_PART, *(f"{LAYER_PART}{index}" for index in range(1, len(parts)))] if len(parts) > 1 else [""]
    parts = [OpenEXR.Part(header, {name: np.ascontiguousarray(plane, np.float32) for name, plane in planes.items()},
                          name) for (header, planes), name in zip(parts, names, strict=True)]
    with atomic_path(path) as temporary, exr_threads(), OpenEXR.File(parts) as file:
        try:
            with open(temporary, "wb") as stream:  # by its name OpenEXR would not notice that its last bytes are lost
                file.write(stream)
        except RuntimeError as error:
            raise OSError(str(error)) from None
        _check_written(temporary, parts)


def _check_written(path, parts):
    """Raise an OSError unless the headers of a file are those of its parts."""
    try:
        found = [set(header["channel names"]) for header, _ in read_parts(path, header_only=True)]
    except ImageError:
        found = []
    if found != [set(part.channels) for part in parts]:
        raise OSError("it reads otherwise than it was written")


@contextmanager
def exr_threads() -> Iterator[None]:
    """OpenEXR's own threads, for as long as it works: a process forked later would wait for them for ever."""
    OpenEXR.set_global_thread_count(thread_count())
    try:
        yield
    finally:
        OpenEXR.set_global_thread_count(0)


def _rgb_planes(rec709):
    return dict(zip("RGB", np.moveaxis(rec709, -1, 0), strict=True))


def _box(origin_px, shape_px):
    (top, left), (rows, columns) = origin_px, shape_px
    return (np.array([left, top], dtype=np.int32), np.array([left + columns - 1, top + rows - 1], dtype=np.int32))


def read_exr(path: str | os.PathLike, pitch_um: float | None = None) -> SpectralImage:
    """Read a spectral EXR.

    Parameters
    ----------
    path : path
    pitch_um : float, optional
        Pixel pitch at the sensor, for a file that does not tell it.

    Returns
    -------
    SpectralImage

    Raises
    ------
    ImageError
        No EXR, no spectral channels, or nothing to tell the pixel pitch by.
    """
    return read_with_planes(path, pitch_um)[0]


def read_with_planes(path: str | os.PathLike, pitch_um: float | None = None, scratch: AnyPath | None = None
                     ) -> tuple[SpectralImage, dict[str, np.ndarray]]:
    """What `read_exr` gives, and all the planes of the picture by channel: those beside the spectral ones, too.

    Where `scratch` names a folder, spectral planes lie in a file there, if all of the file would take too much memory.
    """
    if scratch is not None:
        headers = read_parts(path, header_only=True)
        header = headers[0][0]
        if header["type"] in READ_BY_ROWS and is_large((sum(map(_samples, headers)),)):
            return _first_image([(header, dict.fromkeys(header["channel names"]))], path, pitch_um,
                                partial(_read_by_blocks, path, header, scratch))
    return _first_image(read_parts(path), path, pitch_um)


def read_with_layers(path: str | os.PathLike, pitch_um: float | None = None, scratch: AnyPath | None = None
                     ) -> tuple[SpectralImage, dict[str, np.ndarray], LayeredRadiance | None]:
    """What `read_with_planes` gives, and the layers that the picture is seen in; None where there are none."""
    if scratch is not None and len(read_parts(path, header_only=True)) == 1:
        return *read_with_planes(path, pitch_um, scratch), None
    parts = read_parts(path)
    image, planes = _first_image(parts, path, pitch_um)
    return image, planes, _layered(image, parts, path)


def read_layers(path: str | os.PathLike) -> LayeredRadiance | None:
    """The layers of radiance in a file; None where there are none."""
    return read_with_layers(path)[2]


def _samples(part):
    """How many numbers a part holds, by its header."""
    header, _ = part
    (left, top), (right, bottom) = np.array(header["dataWindow"], dtype=int).tolist()
    return len(header["channel names"]) * (bottom - top + 1) * (right - left + 1)


def _read_by_blocks(path, header, scratch, channels, names):
    """The cube of some channels, in a folder for scratch files, by blocks of rows: so that of these no more is in
    memory. The other channels are; all become the planes of what they are."""
    (left, top), (right, bottom) = np.array(header["dataWindow"], dtype=int).tolist()
    rows, columns = bottom - top + 1, right - left + 1
    others = [name for name in channels if name not in names]
    _check_size(path, [header | {"channel names": others}], 2 * BLOCK_ROWS * columns * len(channels) * SAMPLE_BYTES)
    cube = new_array((len(names), rows, columns), scratch)
    try:
        with exr_threads(), closing(OpenEXR.InputFile(str(path))) as file:
            types = {printable(name): (name, TYPES[str(channel.type)])
                     for name, channel in file.header()["channels"].items()}
            channels |= zip(names, cube, strict=True)
            channels |= {name: np.empty((rows, columns), types[name][1]) for name in others}
            for first in range(0, rows, BLOCK_ROWS):
                last = min(first + BLOCK_ROWS, rows)
                block = file.channels([types[name][0] for name in channels], scanLine1=top + first,
                                      scanLine2=top + last - 1)
                for (name, plane), found in zip(channels.items(), block, strict=True):
                    plane[first:last] = np.frombuffer(found, types[name][1]).reshape(last - first, columns)
    except (OSError, RuntimeError, ValueError, TypeError, KeyError) as error:
        raise ImageError(path, "file", "not readable", f"expected an EXR picture ({error})") from None
    let_go(cube)
    return cube


def _layered(image, parts, path):
    layers = [part for part in parts[1:] if str(part[0].get("name", "")).startswith(LAYER_PART)]
    if not layers:
        return None
    first, *windows = (np.array(header["dataWindow"], dtype=int)[:, ::-1] for header, _ in (parts[0], *layers))
    frame_px = np.ptp(np.array(parts[0][0]["displayWindow"], dtype=int), axis=0)[::-1] + 1
    margins = (side for window in windows for side in (-window[0], window[1] + 1 - frame_px))
    overscan = np.max([image.overscan_px, *margins], axis=0)
    if np.any(overscan > frame_px):
        raise ImageError(path, "layers", f"{overscan.tolist()} px beyond a frame of {frame_px.tolist()}",
                         "expected no more overscan than there is frame")
    grid = replace(image.grid, shape_px=frame_px + 2 * overscan, overscan_px=overscan,
                   centre_px=image.centre_px + first[0] + overscan)
    try:
        return LayeredRadiance([_layer(*part, image.wavelengths_nm, overscan, path) for part in layers],
                               image.wavelengths_nm, grid, image.focal_mm, image.exposure)
    except ImageError as error:
        raise error.at(path) from None


def _layer(header, channels, wavelengths_nm, overscan_px, path):
    missing = {"A", "Z", *map(channel_name, wavelengths_nm)} - channels.keys()
    if missing:
        raise ImageError(path, header["name"], "damaged", f"expected a channel {min(missing)}")
    with np.errstate(over="ignore"):  # what is farther than numbers tell is infinitely far
        depth_mm = channels["Z"] * np.float32(M_TO_MM)
    left, top = header["dataWindow"][0]
    return Layer(np.stack([channels[channel_name(nm)] for nm in wavelengths_nm]), channels["A"],
                 np.where(depth_mm < BACKGROUND_MM, depth_mm, np.float32(np.inf)),
                 (int(top + overscan_px[0]), int(left + overscan_px[1])))


def _stacked(channels, names):
    """A cube of channels, which become its planes: so that each is in memory once."""
    cube = np.empty((len(names), *channels[names[0]].shape), np.float32)
    for plane, name in zip(cube, names, strict=True):
        plane[:] = channels[name]
        channels[name] = plane
    return cube


def _first_image(parts, path, pitch_um, stacked=_stacked):
    """The first part's spectral image, of the cube that `stacked` makes of channels by their names, and its planes."""
    header, channels = parts[0]
    names = sorted(((wavelength, name) for name in channels
                    if (wavelength := channel_wavelength_nm(name)) is not None), key=lambda plane: plane[0])
    if not names:
        raise ImageError(path, "channels", ", ".join(sorted(channels)),
                         "expected spectral channels such as S0.550,000000nm")
    if pitch_um is None:
        pitch_um = _number(header, "lensfield:pitchUm")
    if pitch_um is None:
        raise ImageError(path, "lensfield:pitchUm", "missing", "give the pixel pitch at the sensor in micrometres")
    wavelengths, names = zip(*names, strict=True)
    try:
        image = SpectralImage(stacked(channels, names), wavelengths, pitch_um=pitch_um, **_placement(header),
                              quantity=header.get("lensfield:quantity", RADIANCE), projection=_projection(header),
                              lens_name=header.get("lensfield:lens", ""),
                              f_number_effective=_number(header, "lensfield:fNumberEffective"),
                              focal_mm=_number(header, "lensfield:focalMm"),
                              exposure=_number(header, "lensfield:exposure", 1.0))
    except ImageError as error:
        raise error.at(path) from None
    except (TypeError, ValueError) as error:
        raise ImageError(path, "attributes", "damaged", str(error)) from None
    return image, channels


def read_parts(path: str | os.PathLike, header_only: bool = False) -> list[tuple[dict, dict]]:
    """What an EXR file holds: for each part its header and {channel: array (row, column)}, empty for headers only.

    Headers alone tell `channel names`.

    Raises
    ------
    ImageError
        No EXR, a damaged one, or one that is too large for the memory there is, before that is taken.
    """
    if not os.path.isfile(path):  # of a text too long to be a name, Path.is_file raises
        raise ImageError(path, "file", absence(path), "expected an EXR picture")
    try:
        with exr_threads():
            headers = _headers(path)
            if header_only and headers:
                return [(header, {}) for header in headers]
            _check_size(path, headers)
            with OpenEXR.File(str(path), separate_channels=True) as file:
                # The file empties its own dictionaries when it is closed.
                parts = [(_plain(part.header), {printable(name): channel.pixels
                                                for name, channel in part.channels.items()}) for part in file.parts]
        if len(parts) < max(len(headers), 1):  # parts that it cannot read are left out
            raise ValueError("it ends too early")
    except UnicodeDecodeError:
        raise ImageError(path, "header", "not in UTF-8", "write it again with other names of layers and attributes"
                         ) from None
    except ImageError:
        raise
    except (RuntimeError, ValueError, TypeError, IndexError) as error:
        raise ImageError(path, "file", "not readable", f"expected an EXR picture ({error})") from None
    return parts


def _headers(path):
    """The headers of a file's parts; UnicodeDecodeError where a channel's name is not to be read either."""
    with OpenEXR.File(str(path), header_only=True) as file:
        headers = [_plain(part.header) for part in file.parts]
    for header in headers:
        header["channel names"] = [printable(channel.name) for channel in header.pop("channels")]
    return headers


def _plain(header):
    """A header whose texts cannot steer a terminal."""
    return {name: printable(" ".join(value.splitlines())) if isinstance(value, str) else value
            for name, value in header.items()}


def _check_size(path, headers, beside_bytes=0):
    """Raise an ImageError for a file whose windows ask for more than it can hold, or the machine has beside so much."""
    needed = beside_bytes
    for header in headers:
        data, frame = (math.prod(int(last) - int(first) + 1 for first, last in zip(*header[window], strict=True))
                       for window in ("dataWindow", "displayWindow"))
        if frame > max(EMPTY_PX, MOST_EMPTY * data):
            raise ImageError(path, "displayWindow", f"of {frame / 1e6:.0f} million px",
                             f"expected at most {MOST_EMPTY} times the data window's, which are {data}")
        each = DEEP_BYTES if header["type"] in (OpenEXR.deepscanline, OpenEXR.deeptile) else SAMPLE_BYTES
        needed += data * each * len(header["channel names"]) + frame * SAMPLE_BYTES
    check_room(path, needed, "give a smaller picture, or a machine that has more")


def is_spectral(path: str | os.PathLike) -> bool:
    """Whether a file holds spectral channels, by its headers alone; an ImageError where it is no EXR."""
    return any(channel_wavelength_nm(name) is not None
               for header, _ in read_parts(path, header_only=True) for name in header["channel names"])


def channel_wavelength_nm(name: str) -> float | None:
    """Wavelength of a spectral channel (unpolarised emission or transmission), or None for any other channel."""
    match = CHANNEL.match(name)
    if match is None:
        return None
    try:
        value = float(match[1].replace(",", ".")) * PREFIX.get(match[2], 1.0)
    except ValueError:  # nothing before the unit, or an exponent alone
        return None
    return round((value if match[3] == "m" else SPEED_OF_LIGHT_M_S / value) * 1e9, 9) if value else None


def _number(header, name, absent=None):
    """A number among the attributes, whether written as one or as an array of one; anything else as it is."""
    value = header.get(name, absent)
    return value.item() if isinstance(value, np.ndarray) and value.size == 1 else value


def _projection(header):
    """What a radiance file was captured with: a plane, where it does not tell."""
    if header.get("lensfield:quantity", RADIANCE) != RADIANCE:
        return PLANE
    value = header.get("lensfield:projection", PLANE)
    if not isinstance(value, str) or value not in PROJECTIONS:
        raise ImageError("image", "lensfield:projection", value, f"expected one of {', '.join(PROJECTIONS)}")
    return value


def _placement(header):
    """Overscan and optical axis, from the windows and the file's own attribute.

    The attribute is in the pixel coordinates of the windows, so that it stays true when a program trims the data
    window; without it the axis is in the middle of the display window.
    """
    (data_left, data_top), (data_right, data_bottom) = np.array(header["dataWindow"], dtype=int)
    (left, top), (right, bottom) = np.array(header["displayWindow"], dtype=int)
    row, column = np.ravel(header.get("lensfield:centrePx", ((top + bottom) / 2, (left + right) / 2)))
    margins = (top - data_top, data_bottom - bottom, left - data_left, data_right - right)
    if margins[0] == margins[1] >= 0 and margins[2] == margins[3] >= 0:
        overscan = (int(margins[0]), int(margins[2]))
    else:  # cropped by another program: all that is left is the frame
        overscan = (0, 0)
    return {"overscan_px": overscan, "centre_px": (float(row) - data_top, float(column) - data_left)}
