"""Spectral EXR files: the layout of Fichet, Pacanowski and Wilkie, JCGT 2021, version 1.0.

One FLOAT channel per wavelength, `S0.550,000000nm`, in addition to R, G and B for programs that do not support spectra.
Overscan follows OpenEXR: the data window is larger than the display window. Layers of radiance are further parts of the
file, `layer.1` onwards, from near to far. The first part is the complete pinhole picture. The stray light in an
irradiance is a further part, `stray`, with the same channels; the first part contains it.
"""

import math
import os
import re
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial
from threading import Lock

import numpy as np
import OpenEXR

from ..image.layers import BACKGROUND_MM, Layer, LayeredRadiance
from ..image.projection import FISHEYE, PLANE, Projection
from ..image.sources import Sources
from ..image.spectral_image import RADIANCE, UNITS, SpectralImage
from ..runtime.build_identity import software
from ..runtime.errors import ImageError, InputError, printable
from ..runtime.files import AnyPath, atomic_path
from ..runtime.inputs import check_input
from ..runtime.memory import check_room
from ..runtime.numbers import is_integer
from ..runtime.scratch import is_large, new_array, release_memory
from ..runtime.threads import thread_count
from ..runtime.versions import check_version
from .detail_channels import detail_of, detail_planes, is_detail
from .exr_header import check_header
from .preview import to_rec709
from .stored_sources import ATTRIBUTE, sources_attribute, sources_of

CHANNEL = re.compile(r"^(?:S0|T)\.(\d*,?\d*(?:[Ee][+-]?\d+)?)(Y|Z|E|P|T|G|M|k|h|da|d|c|m|u|n|p)?(m|Hz)$")
PREFIX = dict(Y=1e24, Z=1e21, E=1e18, P=1e15, T=1e12, G=1e9, M=1e6, k=1e3, h=1e2, da=1e1,
              d=1e-1, c=1e-2, m=1e-3, u=1e-6, n=1e-9, p=1e-12)
# Spectra are in single precision, because half precision has few digits for dim light. Their noise hardly compresses:
# ZIP and PIZ save 8 to 25 % in four times the time. Run-length encoding compresses black areas.
SPECTRAL_COMPRESSION, RGB_COMPRESSION = OpenEXR.RLE_COMPRESSION, OpenEXR.ZIP_COMPRESSION
STRAY_COMPRESSION = OpenEXR.PXR24_COMPRESSION  # a fifth of the bytes, because it is smooth; rounds to 1 part in 65,000
MOST_HALF = float(np.finfo(np.float16).max)
ARBITRARY = "arbitrary"
SPEED_OF_LIGHT_M_S = 299792458.0
LAYOUT_VERSION = "1.0"
VERSION = 1
"""Of the attributes and channels that the layout does not define; also of files without `lensfield:version`."""
EMISSIVE_UNITS = "W.m^-2.sr^-1"  # the layout's canonical string; its values are densities per nm
PANORAMA, WITHOUT_POLYNOMIAL = "polynomial", {"plane": PLANE, "equidistant": FISHEYE}  # equidistant: older files
LAYER_PART, STRAY_PART = "layer.", "stray"
SAMPLE_BYTES, DEEP_BYTES = 4, 128  # per pixel and channel, for a number and for an array
EMPTY_PX, MOST_EMPTY = 2**25, 64  # a display window of more pixels may be at most this many times as large as its data
M_TO_MM = 1e3
MOST_ACROSS = 16  # columns of layers in a pixel
CHANNEL_NM = 1e-6  # precision of a channel's name
ASPECT_DIGITS = 7  # of pixelAspectRatio, which is in single precision
TYPES = {"HALF": np.float16, "FLOAT": np.float32, "UINT": np.uint32}
READ_BY_ROWS = OpenEXR.scanlineimage, OpenEXR.tiledimage
BLOCK_ROWS = 64  # rows to read at once: a multiple of most compressions' chunk height


def channel_name(wavelength_nm: float) -> str:
    """Channel of an emissive wavelength, with the layout's decimal comma."""
    return f"S0.{wavelength_nm:.6f}nm".replace(".", ",").replace("S0,", "S0.", 1)


def write_exr(image: SpectralImage, path: str | os.PathLike, other_planes: dict[str, np.ndarray] | None = None,
              layered: LayeredRadiance | None = None, outside: Sources | None = None,
              stray: SpectralImage | None = None, attributes: dict[str, str] | None = None) -> None:
    """Write a spectral image to a file, which appears complete or not at all.

    Radiance has the layout's attribute `emissiveUnits`. Irradiance, for which the layout defines no unit, does not.
    The channels of a `Detail` are in `detail_channels.py`. Both have attributes with the prefix `lensfield:`: version,
    quantity, units (which may be "arbitrary"), pitchUm, and centrePx, the point where the optical axis meets the
    picture, as row and column, in this order and in the pixel coordinates of the windows.
    Captured radiance has focalMm, its squeeze as pixelAspectRatio, and a panorama's also projection and anglePerRadius,
    as in `Projection`; irradiance has lens and fNumberEffective. If R, G and B are exposed, exposure is the factor; the
    spectral channels are never exposed.

    Parameters
    ----------
    image : SpectralImage
    path : path
    other_planes : dict of array (row, column), optional
        Further channels by name, such as A (alpha) and Z (depth).
    layered : LayeredRadiance, optional
        The layers of the picture; each is written with its alpha A, and its depth Z in metres. If their columns are
        finer than the sensor's, the attribute across is their number in one of these, and their windows count them.
    outside : Sources, optional
        Sources of stray light beyond the picture's edges, written as in `stored_sources.py`.
    stray : SpectralImage, optional
        The stray light that the image contains; rounded by up to 1.5e-5 of its value in the file.
    attributes : dict of str, optional
        Further attributes of the header, for `read_attribute`.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import SpectralImage, read_exr, write_exr
    >>> radiance = SpectralImage(np.ones((2, 3, 4)), wavelengths_nm=[500, 600], pitch_um=5)
    >>> write_exr(radiance, "radiance.exr")
    >>> read_exr("radiance.exr").cube.shape
    (2, 3, 4)
    """
    planes = _spectral_planes(image.cube, image.wavelengths_nm, path) | _rgb_planes(to_rec709(image))
    planes |= detail_planes(image.detail) | (other_planes or {})
    parts = [(image.quantity, _header(image) | sources_attribute(outside) | (attributes or {}), planes),
             *(_layer_parts(layered, path) if layered else ())]
    if stray:
        parts.append((STRAY_PART, _header(stray) | {"compression": STRAY_COMPRESSION},
                      _spectral_planes(stray.cube, stray.wavelengths_nm, path) | _rgb_planes(to_rec709(stray))))
    _write(parts, path)
    for each in (image, *(layered.layers if layered else ()), *((stray,) if stray else ())):
        release_memory(each.cube)


def _spectral_planes(cube, wavelengths_nm, path):
    planes = {channel_name(nm): plane for nm, plane in zip(wavelengths_nm, cube, strict=True)}
    if len(planes) < len(wavelengths_nm):
        raise ImageError(path, "wavelengths_nm", np.asarray(wavelengths_nm).tolist(),
                         "expected at least a millionth of a nanometre between them, the precision of channel names")
    return planes


def _layer_parts(layered, path):
    """(name, header, planes) of each layer."""
    (above, left), frame_px = layered.grid.overscan_px, layered.sampling.grid.frame_px
    across = {"lensfield:across": layered.grid.across} if layered.grid.across > 1 else {}
    for number, layer in enumerate(layered.layers, 1):
        origin = layer.origin_px[0] - above, layer.origin_px[1] - left
        depth_m = np.where(layer.depth_mm < BACKGROUND_MM, layer.depth_mm, BACKGROUND_MM) / np.float32(M_TO_MM)
        yield (f"{LAYER_PART}{number}",
               _windows(frame_px, origin, layer.alpha.shape, layered.sampling.grid.squeeze) | across,
               _spectral_planes(layer.cube, layered.wavelengths_nm, path) | detail_planes(layer.detail)
               | {"A": layer.alpha, "Z": depth_m})


def _windows(frame_px, origin_px, shape_px, squeeze):
    """Header fields for the layout of a part of a spectral file. The origin is the frame's first pixel."""
    return {"compression": SPECTRAL_COMPRESSION, "type": OpenEXR.scanlineimage, "pixelAspectRatio": squeeze,
            "displayWindow": _box((0, 0), frame_px), "dataWindow": _box(origin_px, shape_px)}


def _header(image):
    top, left = image.overscan_px
    header = _windows(image.frame_px, (-top, -left), image.cube.shape[1:], image.squeeze) | {
        "spectralLayoutVersion": LAYOUT_VERSION,
        "lensfield:version": VERSION,
        "lensfield:quantity": image.quantity,
        "lensfield:units": ARBITRARY if image.arbitrary else UNITS[image.quantity],
        "lensfield:pitchUm": np.array([image.pitch_um]),  # stored in double precision, unlike a float
        "lensfield:centrePx": np.array([image.centre_px[0] - top, image.centre_px[1] - left]),
    }
    if image.quantity == RADIANCE:
        header["emissiveUnits"] = EMISSIVE_UNITS
        if not image.projection.is_plane:
            header["lensfield:projection"] = PANORAMA
            header["lensfield:anglePerRadius"] = " ".join(map(repr, image.projection.angle_per_radius))
    if image.focal_mm:
        header["lensfield:focalMm"] = np.array([float(image.focal_mm)])
    if image.exposure != 1:
        header["lensfield:exposure"] = np.array([image.exposure])
    if image.lens_name:
        header["lensfield:lens"] = image.lens_name
    if image.f_number_effective:
        header["lensfield:fNumberEffective"] = np.array([float(image.f_number_effective)])
    return header


def write_picture_exr(rec709: np.ndarray, path: str | os.PathLike, alpha: np.ndarray | None = None,
                      attributes: dict[str, str] | None = None) -> None:
    """Write a linear Rec. 709 picture (row, column, 3), with the alpha that it is premultiplied by, as an RGB EXR, with
    further attributes of the header.

    It is for programs that read a spectral file's channels as layers, as Blender does. It is in half precision, unless
    it is brighter than that can be. The file appears complete or not at all.
    """
    planes = _rgb_planes(rec709) | ({} if alpha is None else {"A": alpha})
    if np.abs(rec709).max() <= MOST_HALF:
        planes = {name: plane.astype(np.float16) for name, plane in planes.items()}
    _write_zipped(planes, path, attributes)


def write_rgb_exr(values: np.ndarray, path: str | os.PathLike, attributes: dict[str, str] | None = None) -> None:
    """Write an array (row, column, 3) as the R, G and B of an EXR in single precision, with further attributes of the
    header. The file appears complete or not at all."""
    _write_zipped(_rgb_planes(values), path, attributes)


def write_plane_exr(plane: np.ndarray, path: str | os.PathLike, attributes: dict[str, str] | None = None) -> None:
    """Write numbers (row, column) as an EXR with the single channel Y, with further attributes of the header. The file
    appears complete or not at all."""
    _write_zipped({"Y": plane}, path, attributes)


def write_layers_exr(planes: dict[str, np.ndarray], path: str | os.PathLike, attributes: dict[str, str]) -> None:
    """Write planes (row, column) by channel, in layers such as ViewLayer.Depth.Z, as an EXR in single precision, with
    further attributes of the header. The file appears complete or not at all."""
    _write_zipped(planes, path, attributes)


def write_planes_exr(planes: dict[str, np.ndarray], path: str | os.PathLike, attributes: dict[str, str]) -> None:
    """Write planes (row, column) by channel, uncompressed, with attributes of the header, for another program to read.

    The file appears complete or not at all.
    """
    _write([("", attributes | {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}, planes)], path)


def _write_zipped(planes, path, attributes=None):
    header = {"compression": RGB_COMPRESSION, "type": OpenEXR.scanlineimage} | (attributes or {})
    _write([("", header, planes)], path)


def _write(parts, path):
    parts[0][1]["software"] = software()
    parts = [OpenEXR.Part(header, {channel: _contiguous(plane) for channel, plane in planes.items()},
                          name if len(parts) > 1 else "") for name, header, planes in parts]
    with atomic_path(path) as temporary, exr_threads(), OpenEXR.File(parts) as file:
        try:
            with open(temporary, "wb") as stream:  # given a path, OpenEXR does not notice if the last bytes are lost
                file.write(stream)
        except RuntimeError as error:
            raise OSError(str(error)) from None
        _check_written(temporary, parts)


def _contiguous(plane):
    """A plane as a file stores it: in half precision if it is, otherwise in single."""
    return np.ascontiguousarray(plane, np.float16 if plane.dtype == np.float16 else np.float32)


def _check_written(path, parts):
    """Raise an OSError unless the headers in a file match its parts."""
    os.stat(path)  # the system's reason if the folder has been moved meanwhile
    try:
        channels = [set(header["channel names"]) for header, _ in read_parts(path, header_only=True)]
    except ImageError:
        channels = []
    if channels != [set(part.channels) for part in parts]:
        raise OSError("the file's headers differ from the written data")


class _ThreadUsers:
    """The number of blocks that use OpenEXR's threads. While there are any, the threads neither end nor change: a file
    that is being written would wait for their work for ever."""

    def __init__(self) -> None:
        self._lock, self._count = Lock(), 0

    def add(self, more: int) -> None:
        """Count more or fewer users: the first one starts the threads, and the last one ends them."""
        with self._lock:
            before, self._count = self._count, self._count + more
            if not before or not self._count:
                OpenEXR.set_global_thread_count(thread_count() if self._count else 0)


_thread_users = _ThreadUsers()


@contextmanager
def exr_threads() -> Iterator[None]:
    """OpenEXR's threads, limited to the block, because a process forked later would wait for them for ever."""
    _thread_users.add(1)
    try:
        yield
    finally:
        _thread_users.add(-1)


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
        Pixel pitch at the sensor, for a file that does not state it.

    Returns
    -------
    SpectralImage

    Raises
    ------
    ImageError
        The file is not an EXR, lacks spectral channels, or does not state its pixel pitch.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import SpectralImage, read_exr, write_exr
    >>> write_exr(SpectralImage(np.ones((2, 3, 4)), wavelengths_nm=[500, 600], pitch_um=5), "radiance.exr")
    >>> read_exr("radiance.exr").wavelengths_nm.tolist()
    [500.0, 600.0]
    """
    return read_with_planes(path, pitch_um)[0]


def read_header(path: str | os.PathLike, pitch_um: float | None = None) -> tuple[SpectralImage, list[str]]:
    """As `read_exr`, without light and detail, from the header alone, and the names of the file's other channels.

    Its cube takes no memory: all pixels are the same zero.
    """
    header = read_parts(path, header_only=True)[0][0]
    names = [name for name in header["channel names"] if not is_detail(name)]

    def black(channels, names):
        (left, top), (right, bottom) = np.array(header["dataWindow"], dtype=int).tolist()
        return np.broadcast_to(np.float32(0), (len(names), bottom - top + 1, right - left + 1))

    image, channels = _first_image([(header, dict.fromkeys(names))], path, pitch_um, black)
    return image, list(channels)


def read_with_planes(path: str | os.PathLike, pitch_um: float | None = None, scratch: AnyPath | None = None
                     ) -> tuple[SpectralImage, dict[str, np.ndarray]]:
    """The result of `read_exr`, and all planes of the picture by channel, including the non-spectral channels.

    If `scratch` is a folder and the data would take too much memory, spectral planes are stored in a file there.
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
    """The result of `read_with_planes`, and the picture's layers; None for a file without layers."""
    if scratch is not None and len(read_parts(path, header_only=True)) == 1:
        return *read_with_planes(path, pitch_um, scratch), None
    parts = read_parts(path)
    image, planes = _first_image(parts, path, pitch_um)
    return image, planes, _layered(image, parts, path)


def read_sources(path: str | os.PathLike) -> Sources | None:
    """The sources of stray light beyond a picture's edges, at the wavelengths of its channels' names; None if its file
    does not state them, as for pictures of other programs.

    Raises
    ------
    ImageError
        The file is not an EXR, or the attribute is damaged or states other wavelengths.
    """
    header = read_parts(path, header_only=True)[0][0]
    sources, nm = sources_of(header, path), sorted(filter(None, map(channel_wavelength_nm, header["channel names"])))
    if sources is None or not nm:
        return sources
    stated_nm = sources.wavelengths_nm
    if len(nm) != len(stated_nm) or np.any(np.abs(stated_nm - nm) > CHANNEL_NM):
        raise ImageError(path, f"wavelengths in {ATTRIBUTE}", stated_nm.tolist(), f"expected the picture's {nm}")
    return replace(sources, wavelengths_nm=np.array(nm))


def read_attribute(path: str | os.PathLike, name: str) -> str:
    """The text of an attribute of a file's header; "" without it."""
    return str(read_parts(path, header_only=True)[0][0].get(name, ""))


def read_stray(path: str | os.PathLike) -> SpectralImage | None:
    """The stray light in an irradiance file; None for a file without it."""
    parts = [part for part in read_parts(path) if part[0].get("name") == STRAY_PART]
    return _first_image(parts, path, None)[0] if parts else None


def _samples(part):
    """Number of samples in a part, from its header."""
    header, _ = part
    (left, top), (right, bottom) = np.array(header["dataWindow"], dtype=int).tolist()
    return len(header["channel names"]) * (bottom - top + 1) * (right - left + 1)


def _read_by_blocks(path, header, scratch, channels, names):
    """Read some channels into a cube in a scratch file, in blocks of rows to limit memory.

    The other channels are read into memory. `channels` is updated with all planes.
    """
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
                for (name, plane), samples in zip(channels.items(), block, strict=True):
                    plane[first:last] = np.frombuffer(samples, types[name][1]).reshape(last - first, columns)
    except (OSError, RuntimeError, ValueError, TypeError, KeyError) as error:
        raise ImageError(path, "file", "not readable", f"expected an EXR picture ({error})") from None
    release_memory(cube)
    return cube


def _layered(image, parts, path):
    layers = [part for part in parts[1:] if str(part[0].get("name", "")).startswith(LAYER_PART)]
    if not layers:
        return None
    windows = [np.array(header["dataWindow"], dtype=int)[:, ::-1] for header, _ in layers]
    across = _across(layers, path)
    picture = image.grid.frame().finer_across(across)
    margins = (side for window in windows for side in (-window[0], window[1] + 1 - picture.shape_px))
    overscan = np.max([image.overscan_px * np.array([1, across]), *margins], axis=0)
    overscan[1] += -overscan[1] % across
    if np.any(overscan > picture.shape_px):
        raise ImageError(path, "layers", f"{overscan.tolist()} px beyond a frame of {list(picture.shape_px)}",
                         "expected overscan no larger than the frame")
    grid = picture.with_overscan(overscan)
    try:
        return LayeredRadiance([_layer(*part, image.wavelengths_nm, overscan, path) for part in layers],
                               image.wavelengths_nm, grid, image.focal_mm, image.exposure, image.arbitrary)
    except ImageError as error:
        raise error.at(path) from None


def _across(layers, path):
    """The layers' columns in a column of the sensor."""
    numbers = [header.get("lensfield:across", 1) for header, _ in layers]
    if any(not is_integer(number) or not 1 <= number <= MOST_ACROSS or number != numbers[0] for number in numbers):
        raise ImageError(path, "lensfield:across", ", ".join(map(str, numbers)),
                         f"expected the same whole number up to {MOST_ACROSS} for all layers")
    return int(numbers[0])


def _layer(header, channels, wavelengths_nm, overscan_px, path):
    missing = {"A", "Z", *map(channel_name, wavelengths_nm)} - channels.keys()
    if missing:
        raise ImageError(path, header["name"], "damaged", f"expected a channel {min(missing)}")
    with np.errstate(over="ignore"):  # distances that overflow become infinite
        depth_mm = channels["Z"] * np.float32(M_TO_MM)
    left, top = header["dataWindow"][0]
    return Layer(np.stack([channels[channel_name(nm)] for nm in wavelengths_nm]), channels["A"],
                 np.where(depth_mm >= BACKGROUND_MM, np.float32(np.inf), depth_mm),
                 (int(top + overscan_px[0]), int(left + overscan_px[1])), detail_of(channels, header["name"]))


def _stacked(channels, names):
    """A cube of channels. The channels become views of its planes, so each is in memory only once."""
    cube = np.empty((len(names), *channels[names[0]].shape), np.float32)
    for plane, name in zip(cube, names, strict=True):
        plane[:] = channels[name]
        channels[name] = plane
    return cube


def _first_image(parts, path, pitch_um, stacked=_stacked):
    """The first part's spectral image, whose cube `stacked` creates from channels by their names, and its planes."""
    header, channels = parts[0]
    check_version(path, header.get("lensfield:version", VERSION), [VERSION], ImageError, "lensfield:version")
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
                              squeeze=_squeeze(header), lens_name=header.get("lensfield:lens", ""),
                              f_number_effective=_number(header, "lensfield:fNumberEffective"),
                              focal_mm=_number(header, "lensfield:focalMm"),
                              exposure=_number(header, "lensfield:exposure", 1.0), detail=detail_of(channels, path),
                              arbitrary=header.get("lensfield:units") == ARBITRARY)
    except ImageError as error:
        raise error.at(path) from None
    except InputError:  # of a full disk
        raise
    except (TypeError, ValueError) as error:
        raise ImageError(path, "attributes", "damaged", str(error)) from None
    return image, channels


def read_parts(path: str | os.PathLike, header_only: bool = False) -> list[tuple[dict, dict]]:
    """The contents of an EXR file: for each part its header and {channel: array (row, column)}.

    With `header_only`, the dicts of channels are empty, and each header has an additional field `channel names`.

    Raises
    ------
    ImageError
        The file is not an EXR, is damaged, or is too large for the available memory, which is checked beforehand.
    """
    check_input(path, "file", "expected an EXR picture", error=ImageError)
    try:
        check_header(path)
        with exr_threads():
            headers = _headers(path)
            if header_only and headers:
                return [(header, {}) for header in headers]
            _check_size(path, headers)
            with OpenEXR.File(str(path), separate_channels=True) as file:
                # Copied, because the file empties its dictionaries when it is closed.
                parts = [(_printable_header(part.header), {printable(name): channel.pixels
                                                           for name, channel in part.channels.items()})
                         for part in file.parts]
        if len(parts) < max(len(headers), 1):  # OpenEXR omits parts that it cannot read
            raise ValueError("the file is truncated")
    except UnicodeDecodeError:
        raise ImageError(path, "header", "not in UTF-8", "save it again with other layer and attribute names"
                         ) from None
    except ImageError:
        raise
    except (RuntimeError, ValueError, TypeError, IndexError, ArithmeticError) as error:
        raise ImageError(path, "file", "not readable", f"expected an EXR picture ({error})") from None
    return parts


def _headers(path):
    """The headers of a file's parts; raise a UnicodeDecodeError if a channel's name is not in UTF-8."""
    with OpenEXR.File(str(path), header_only=True) as file:
        headers = [_printable_header(part.header) for part in file.parts]
    for header in headers:
        header["channel names"] = [printable(channel.name) for channel in header.pop("channels")]
    return headers


def _printable_header(header):
    """A header whose texts contain no control characters for a terminal."""
    return {name: printable(" ".join(value.splitlines())) if isinstance(value, str) else value
            for name, value in header.items()}


def _check_size(path, headers, extra_bytes=0):
    """Raise an ImageError if a file's windows are implausibly large, or if it and `extra_bytes` exceed free memory."""
    needed = extra_bytes
    for header in headers:
        data, frame = (math.prod(int(last) - int(first) + 1 for first, last in zip(*header[window], strict=True))
                       for window in ("dataWindow", "displayWindow"))
        if frame > max(EMPTY_PX, MOST_EMPTY * data):
            raise ImageError(path, "displayWindow", f"of {frame / 1e6:.0f} million px",
                             f"expected at most {MOST_EMPTY} times the {data} px of the data window")
        each = DEEP_BYTES if header["type"] in (OpenEXR.deepscanline, OpenEXR.deeptile) else SAMPLE_BYTES
        needed += data * each * len(header["channel names"]) + frame * SAMPLE_BYTES
    check_room(path, needed, "give a smaller picture, or use a machine with more memory")


def is_spectral(path: str | os.PathLike) -> bool:
    """Whether a file has spectral channels, from its headers alone; raise an ImageError if it is not an EXR."""
    return any(channel_wavelength_nm(name) is not None
               for header, _ in read_parts(path, header_only=True) for name in header["channel names"])


def channel_wavelength_nm(name: str) -> float | None:
    """Wavelength of a spectral channel (unpolarised emission or transmission), or None for any other channel."""
    match = CHANNEL.match(name)
    if match is None:
        return None
    try:
        value = float(match[1].replace(",", ".")) * PREFIX.get(match[2], 1.0)
    except ValueError:  # empty before the unit, or only an exponent
        return None
    return round((value if match[3] == "m" else SPEED_OF_LIGHT_M_S / value) * 1e9, 9) if value else None


def _number(header, name, absent=None):
    """An attribute; if it is an array of one number, that number."""
    value = header.get(name, absent)
    return value.item() if isinstance(value, np.ndarray) and value.size == 1 else value


def _projection(header):
    """The projection of a radiance file's capture: a plane, if the file does not state it."""
    if header.get("lensfield:quantity", RADIANCE) != RADIANCE:
        return PLANE
    value = header.get("lensfield:projection", "plane")
    known = *WITHOUT_POLYNOMIAL, PANORAMA
    if not isinstance(value, str) or value not in known:
        raise ImageError("image", "lensfield:projection", value, f"expected one of {', '.join(known)}")
    if value == PANORAMA:
        return _panorama(header.get("lensfield:anglePerRadius", ""))
    return WITHOUT_POLYNOMIAL[value]


def _squeeze(header):
    """The squeeze of a radiance file's capture, to the precision of the attribute."""
    if header.get("lensfield:quantity", RADIANCE) != RADIANCE:
        return 1.0
    return float(f"{header.get('pixelAspectRatio', 1.0):.{ASPECT_DIGITS}g}")


def _panorama(coefficients):
    try:
        panorama = Projection(tuple(map(float, coefficients.split())))
    except (AttributeError, ValueError):
        panorama = PLANE
    if panorama.is_plane:
        raise ImageError("image", "lensfield:anglePerRadius", coefficients,
                         "expected 1 to 4 numbers, the first above 0")
    return panorama


def _placement(header):
    """Overscan and optical axis, from the windows and the file's attribute.

    The attribute is in the pixel coordinates of the windows, so it stays valid if a program trims the data window.
    Without it, the axis is in the middle of the display window.
    """
    (data_left, data_top), (data_right, data_bottom) = np.array(header["dataWindow"], dtype=int)
    (left, top), (right, bottom) = np.array(header["displayWindow"], dtype=int)
    row, column = np.ravel(header.get("lensfield:centrePx", ((top + bottom) / 2, (left + right) / 2)))
    margins = (top - data_top, data_bottom - bottom, left - data_left, data_right - right)
    if margins[0] == margins[1] >= 0 and margins[2] == margins[3] >= 0:
        overscan = (int(margins[0]), int(margins[2]))
    else:  # cropped by another program: treat all of it as the frame
        overscan = (0, 0)
    return {"overscan_px": overscan, "centre_px": (float(row) - data_top, float(column) - data_left)}
