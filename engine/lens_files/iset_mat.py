"""ISETCam's .mat files of ray-trace optics, saved by its import of a bundle.

Such a file does not state the orientation of its PSFs. According to ISETCam's code, a Zemax listing is stored with its
rows reversed (`zemaxLoad`), so that they ascend with y, for image points at -y; a matrix from CODE V is stored
unchanged, for points at +y.
"""

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path, PureWindowsPath

import numpy as np

from ..lens.conventions import four_by_three
from ..lens.radial_lens import RadialLens
from ..runtime.errors import LensError
from ..runtime.files import temporary_folder
from ..runtime.inputs import check_input, open_input
from ..runtime.text import object_distance
from .assembly import ISET_ASSUMED, build_lens, entrance_pupil
from .npz import MOST_EXPANSION, SMALL_BYTES, read_arrays
from .psf_grid import PsfGrid

CHILD = Path(__file__).with_name("iset_mat_child.py")
TIMEOUT_S = 120
READER_BYTES, COPIES = 2**27, 3  # memory for reading, in addition to this many copies of the arrays
HEADER_BYTES, COMPRESSED = 128, 15
NUMBERS = {"efl_mm": "effectiveFocalLength", "magnification": "mag", "f_number_effective": "effectiveFNumber",
           "object_distance_mm": "objectDistance", "reference_wavelength_nm": "referenceWavelength"}
HDF5 = b"\x89HDF\r\n\x1a\n"


def read_iset_mat(path: str | Path) -> RadialLens:
    """Read the lens in an ISETCam .mat, in a separate process.

    Raises
    ------
    LensError
        The file is damaged, of version 7.3, or lacks a part of the ray-trace structure.
    """
    parts = _parts(path)
    heights = _array(parts, "psf.fieldHeight", path, 1)
    wavelengths = _array(parts, "psf.wavelength", path, 1)
    if heights.size < 2:
        raise LensError(path, "psf.fieldHeight", f"{heights.size} heights", "expected two or more")
    first_order, note = _first_order(parts, heights[-1], path)
    name = PureWindowsPath(_text(parts, "lensFile")).stem or Path(path).stem
    tables = {"real_height_mm": np.abs(_table(parts, "geometry", heights, wavelengths, path)),
              "relative_illumination": _table(parts, "relIllum", heights, wavelengths, path)}
    code_v = "code" in _text(parts, "program").lower()
    return build_lens(
        path, _psf_reader(parts, heights.size, wavelengths.size, code_v, path), "+y" if code_v else "-y", name=name,
        source=f"ISETCam file {Path(path).name}", wavelengths_nm=wavelengths, heights_mm=heights,
        sensor_mm=four_by_three(heights[-1]), **first_order, **tables,
        notes=f"{note} {ISET_ASSUMED} The file does not state the orientation of its PSFs: assumed as ISETCam stores "
              f"PSFs from {'CODE V' if code_v else 'Zemax'}.")


def _first_order(parts, last_height_mm, path):
    """First-order fields of `Lens`, and a note on assumptions."""
    facts = {field: _number(parts, name, path) for field, name in NUMBERS.items()}
    facts["object_distance_mm"] = object_distance(facts["object_distance_mm"])
    half_field_deg = _number(parts, "maxfov", path) if "maxfov" in parts else 0.0
    facts["entrance_pupil_mm"], note = entrance_pupil(half_field_deg, last_height_mm, facts["magnification"],
                                                      facts["object_distance_mm"], facts["efl_mm"])
    return facts, note


def _parts(path):
    """Names and arrays of the ray-trace structure."""
    _check_kind(path)
    array_bytes = _stated_bytes(path)
    with temporary_folder() as folder:
        target = folder / "parts.npz"
        _run_child(path, target, READER_BYTES + COPIES * array_bytes)
        return read_arrays(target)


def _stated_bytes(path):
    """Bytes of a file's variables as their tags state them, without decoding; a LensError if implausibly many."""
    stated = 0
    with open_input(path) as stream:
        order = "<" if stream.read(HEADER_BYTES)[-2:] == b"IM" else ">"
        while len(tag := stream.read(8)) == 8:
            kind, size = struct.unpack(f"{order}II", tag)
            following = stream.tell() + size
            if kind == COMPRESSED:
                try:
                    inner = zlib.decompressobj().decompress(stream.read(min(size, 99)), 8)
                    _, size = struct.unpack(f"{order}II", inner)
                except (zlib.error, struct.error):
                    raise LensError(path, ".mat file", "damaged", "save it again from MATLAB") from None
            stated += size
            stream.seek(following)
        most = SMALL_BYTES + MOST_EXPANSION * stream.seek(0, os.SEEK_END)
    if stated > most:
        raise LensError(path, ".mat file", f"{stated / 1e6:.0f} MB according to its tags",
                        f"expected at most {most / 1e6:.0f} MB for a file of this size")
    return stated


def _run_child(path, target, memory_bytes):
    """Write the parts of a .mat to a .npz, in a separate process."""
    command = [sys.executable, "-P", str(CHILD), os.path.abspath(path), str(target), str(memory_bytes)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "PYTHONIOENCODING": "utf-8"}
    try:
        reader = subprocess.run(command, env=environment, capture_output=True, timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        raise LensError(path, ".mat file", f"still unread after {TIMEOUT_S} s", "save it again from MATLAB") from None
    if reader.returncode:
        raise _refusal(path, reader.stderr)


def _refusal(path, error_output):
    """The error for a file that its reader failed to read, with the last line of the reader's output."""
    lines = error_output.decode("utf-8", errors="replace").split("\n")
    reason = next((line for line in reversed(lines) if line.strip()), "its reader crashed")
    return LensError(path, ".mat file", "not readable", f"save the optics again from ISETCam ({reason})")


def _check_kind(path):
    check_input(path, "file", "expected an ISETCam .mat file", error=LensError)
    with open_input(path) as stream:
        head = stream.read(520)
    if head.startswith(b"MATLAB 7.3") or HDF5 in (head[:8], head[512:]):
        raise LensError(path, ".mat file", "version 7.3", "save it from MATLAB with the option -v7")


def _text(parts, name):
    return str(parts[name]) if name in parts and parts[name].dtype.kind == "U" else ""


def _array(parts, name, path, dimensions):
    """float array with at least this number of dimensions."""
    value = parts.get(name)
    if value is None or value.dtype.kind not in "fiub" or not value.size:
        raise LensError(path, name, "missing" if value is None else "without numbers",
                        "expected the ray-trace optics of ISETCam")
    return np.array(value, dtype=float, ndmin=dimensions)


def _number(parts, name, path):
    value = _array(parts, name, path, 0)
    if value.size != 1:
        raise LensError(path, name, f"{value.size} numbers", "expected one")
    return float(value.reshape(()))


def _table(parts, kind, heights, wavelengths, path):
    """float array (wavelength, height) of geometry or relative illumination. Its sampling must match the PSFs'."""
    table = _array(parts, f"{kind}.function", path, 1)
    for name, axis in (("fieldHeight", heights), ("wavelength", wavelengths)):
        values = _array(parts, f"{kind}.{name}", path, 1)
        if values.shape != axis.shape or np.any(np.abs(values - axis) > 1e-6 * np.abs(axis).max()):
            raise LensError(path, f"{kind}.{name}", f"{values.size} values", f"expected the values of psf.{name}")
    if table.size != heights.size * wavelengths.size:
        raise LensError(path, f"{kind}.function", f"of shape {table.shape}",
                        f"expected {heights.size} heights x {wavelengths.size} wavelengths")
    return table.reshape(heights.size, wavelengths.size).T


def _psf_reader(parts, heights, wavelengths, code_v, path):
    """A function of (height number, wavelength number) that returns PSFs from the array of all of them."""
    psfs = _array(parts, "psf.function", path, 2)
    side = psfs.shape[0]
    if psfs.size != side * side * heights * wavelengths:
        raise LensError(path, "psf.function", f"of shape {psfs.shape}", f"expected n x n x {heights} x {wavelengths}")
    psfs = psfs.reshape(side, side, heights, wavelengths)
    pitch_um = 1e3 * _array(parts, "psf.sampleSpacing", path, 1).ravel()
    if np.ptp(pitch_um) > 1e-6 * np.abs(pitch_um).max():
        raise LensError(path, "psf.sampleSpacing", pitch_um.tolist(), "expected the same along both axes")
    middle = side // 2 if code_v else _middle(psfs)
    return lambda h, w: PsfGrid(path, psfs[:, :, h - 1, w - 1], float(pitch_um[0]), (middle, middle))


def _middle(psfs):
    """Row and column of the chief ray, from the PSFs' symmetry: n / 2 in a Huygens listing, one less in an FFT's."""
    total = np.nan_to_num(psfs).sum(axis=(2, 3))
    side = total.shape[1]

    def asymmetry(column):
        reach = min(column, side - 1 - column)
        about = total[:, column - reach:column + reach + 1]
        return np.abs(about - about[:, ::-1]).sum()

    return min(side // 2, max(0, side // 2 - 1), key=asymmetry)
