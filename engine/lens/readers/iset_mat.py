"""ISETCam's .mat files of ray-trace optics: what its import of a bundle has saved.

Nothing in such a file tells how its PSFs lie. By ISETCam's code: a Zemax listing is stored with its rows reversed
(`zemaxLoad`), so that they ascend with y, for image points at -y; a matrix from CODE V as it is, for points at +y.
"""

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path, PureWindowsPath

import numpy as np

from ...errors import LensError, absence
from ...files import temporary_folder
from ..lens import Lens
from .assembly import ISET_ASSUMED, build_lens, entrance_pupil, four_by_three, object_distance
from .npz import MOST_EXPANSION, SMALL_BYTES, read_arrays
from .psf_grid import PsfGrid

CHILD = Path(__file__).with_name("iset_mat_child.py")
TIMEOUT_S = 120
READER_BYTES, COPIES = 2**27, 3  # what reading takes beside the arrays, and how many times these
HEADER_BYTES, COMPRESSED = 128, 15
NUMBERS = {"efl_mm": "effectiveFocalLength", "magnification": "mag", "f_number_effective": "effectiveFNumber",
           "object_distance_mm": "objectDistance", "reference_wavelength_nm": "referenceWavelength"}
HDF5 = b"\x89HDF\r\n\x1a\n"


def read_iset_mat(path: str | Path) -> Lens:
    """The lens of an ISETCam .mat, read in a process of its own.

    Raises
    ------
    LensError
        A file that is damaged, of version 7.3, or without a part of the ray-trace structure.
    """
    parts = _parts(path)
    heights, wavelengths = (_array(parts, f"psf.{name}", path, 1) for name in ("fieldHeight", "wavelength"))
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
        notes=f"{note} {ISET_ASSUMED} The file does not tell how its PSFs lie: taken as ISETCam stores those of "
              f"{'CODE V' if code_v else 'Zemax'}.")


def _first_order(parts, last_height_mm, path):
    """First-order fields of Lens, and a note on what is assumed of them."""
    facts = {field: _number(parts, name, path) for field, name in NUMBERS.items()}
    facts["object_distance_mm"] = object_distance(facts["object_distance_mm"])
    half_field_deg = _number(parts, "maxfov", path) if "maxfov" in parts else 0.0
    facts["entrance_pupil_mm"], note = entrance_pupil(half_field_deg, last_height_mm, facts["magnification"],
                                                      facts["object_distance_mm"], facts["efl_mm"])
    return facts, note


def _parts(path):
    """Names and arrays of the ray-trace structure."""
    _check_kind(path)
    held = _told_bytes(path)
    with temporary_folder() as folder:
        target = folder / "parts.npz"
        _run_child(path, target, READER_BYTES + COPIES * held)
        return read_arrays(target)


def _told_bytes(path):
    """How many bytes the variables of a file say that they are, without decoding them; no more than it may hold."""
    told = 0
    with open(path, "rb") as stream:
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
            told += size
            stream.seek(following)
        most = SMALL_BYTES + MOST_EXPANSION * stream.seek(0, os.SEEK_END)
    if told > most:
        raise LensError(path, ".mat file", f"of {told / 1e6:.0f} MB by what it says",
                        f"expected {most / 1e6:.0f} MB at most of a file of its size")
    return told


def _run_child(path, target, memory_bytes):
    """Have the parts of a .mat written to a .npz by a process of its own."""
    command = [sys.executable, "-P", str(CHILD), os.path.abspath(path), str(target), str(memory_bytes)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "PYTHONIOENCODING": "utf-8"}
    try:
        done = subprocess.run(command, env=environment, capture_output=True, timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        raise LensError(path, ".mat file", f"not read in {TIMEOUT_S} s", "save it again from MATLAB") from None
    if done.returncode:
        raise _refusal(path, done.stderr)


def _refusal(path, said):
    """The error about a file at which its reader has failed, with the last line that it said."""
    lines = said.decode("utf-8", errors="replace").split("\n")
    why = next((line for line in reversed(lines) if line.strip()), "its reader crashed")
    return LensError(path, ".mat file", "not readable", f"save the optics again from ISETCam ({why})")


def _check_kind(path):
    if not os.path.isfile(path):
        raise LensError(path, "file", absence(path), "expected an ISETCam .mat file")
    with open(path, "rb") as stream:
        head = stream.read(520)
    if head.startswith(b"MATLAB 7.3") or HDF5 in (head[:8], head[512:]):
        raise LensError(path, ".mat file", "of version 7.3", "save it from MATLAB with the option -v7")


def _text(parts, name):
    return str(parts[name]) if name in parts and parts[name].dtype.kind == "U" else ""


def _array(parts, name, path, dimensions):
    """float array, of at least so many dimensions."""
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
    """float array (wavelength, height) of geometry or relative illumination, which must be sampled as the PSFs are."""
    values = _array(parts, f"{kind}.function", path, 1)
    for name, axis in (("fieldHeight", heights), ("wavelength", wavelengths)):
        told = _array(parts, f"{kind}.{name}", path, 1)
        if told.shape != axis.shape or np.any(np.abs(told - axis) > 1e-6 * np.abs(axis).max()):
            raise LensError(path, f"{kind}.{name}", f"{told.size} values", "expected those of psf." + name)
    if values.size != heights.size * wavelengths.size:
        raise LensError(path, f"{kind}.function", f"of shape {values.shape}",
                        f"expected {heights.size} heights x {wavelengths.size} wavelengths")
    return values.reshape(heights.size, wavelengths.size).T


def _psf_reader(parts, heights, wavelengths, code_v, path):
    """A function of (height number, wavelength number) that takes PSFs from the array of them all."""
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
    """Row and column of the chief ray: n / 2 of a Huygens listing, one less of an FFT's, told by the PSFs' symmetry."""
    whole = np.nan_to_num(psfs).sum(axis=(2, 3))
    side = whole.shape[1]

    def asymmetry(column):
        reach = min(column, side - 1 - column)
        about = whole[:, column - reach:column + reach + 1]
        return np.abs(about - about[:, ::-1]).sum()

    return min(side // 2, max(0, side // 2 - 1), key=asymmetry)
