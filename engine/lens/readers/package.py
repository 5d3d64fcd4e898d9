"""The project's own lens package: one .npz of plain arrays and a JSON header, never a pickle.

PSFs are stored as amplitudes, the square roots of their samples over the largest, in 16 bits: faint tails keep their
digits, and no PSF changes by more than some 1e-4 of its light. Of mirror-symmetric ones one half is stored.
"""

import json
from dataclasses import fields
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import LensError, shown
from ...files import atomic_path
from ..lens import Lens
from .npz import read_arrays

FORMAT = "lensfield-lens"
VERSION = 2
ARRAYS = ("wavelengths_nm", "heights_mm", "real_height_mm", "relative_illumination", "enclosed_energy", "transmittance")
ADDED = ("point_flux",)  # since packages were first written: older ones are without
SCALARS = tuple(field.name for field in fields(Lens) if field.name not in (*ARRAYS, *ADDED, "psf", "prescription"))
MEMBERS = ("header", *ARRAYS, *ADDED, "psf_amplitude")
AMPLITUDE_STEPS = np.iinfo(np.uint16).max


def write_package(lens: Lens, path: str | Path) -> None:
    """Write `lens` to `path`, whole or not at all."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(package_bytes(lens))


def package_bytes(lens: Lens) -> bytes:
    """The contents of the file that `write_package` writes."""
    stream = BytesIO()
    header = {"format": FORMAT, "version": VERSION} | {name: getattr(lens, name) for name in SCALARS}
    arrays = {name: getattr(lens, name) for name in (*ARRAYS, *ADDED)} | {"psf_amplitude": _amplitudes(lens.psf)}
    np.savez_compressed(stream, header=np.array(json.dumps(header)), **arrays)
    return stream.getvalue()


def read_header(path: str | Path) -> dict[str, Any]:
    """The figures and texts of a lens package, without its tables: dict of the fields of `Lens`."""
    return _header(_contents(path, MEMBERS[:1]), path)


def read_package(path: str | Path | BytesIO) -> Lens:
    """Read a lens package: a file, or its contents.

    Raises
    ------
    LensError
        A file that is no package, of a later version, or with a field that is missing or cannot be right.
    """
    contents = _contents(path)
    header = _header(contents, path)
    missing = [name for name in (*ARRAYS, "psf_amplitude") if name not in contents]
    missing += [name for name in SCALARS if name not in header]
    if missing:
        raise LensError(path, missing[0], "missing", f"a lens package of version {VERSION} has it")
    try:
        return Lens(**{name: header[name] for name in SCALARS}, **{name: contents[name] for name in ARRAYS},
                    **{name: contents[name] for name in ADDED if name in contents},
                    psf=_psfs(contents["psf_amplitude"]))
    except LensError as error:
        raise error.at(path) from None
    except (TypeError, ValueError) as error:
        raise LensError(path, "lens package", "damaged", str(error)) from None


def _contents(path, names=MEMBERS):
    """Arrays of a .npz by name, those of these that it has."""
    try:
        return read_arrays(path, names)
    except Exception as error:  # damaged bytes lead numpy's and zip's readers to errors of a dozen kinds
        raise LensError(path, "lens package", "not readable", f"expected a .npz lens package ({error})") from None


def _amplitudes(psf):
    """uint16 array (wavelength, height, v, u), of the half with u >= 0 where the other is its exact mirror image."""
    peaks = psf.max(axis=(2, 3), keepdims=True)
    amplitudes = np.rint(AMPLITUDE_STEPS * np.sqrt(psf / peaks)).astype(np.uint16)
    mirrored = psf.shape[-1] % 2 == 1 and np.array_equal(psf, psf[..., ::-1])
    return amplitudes[..., psf.shape[-1] // 2:] if mirrored else amplitudes


def _psfs(amplitudes):
    """PSFs of unit sum from `_amplitudes`."""
    if amplitudes.dtype != np.uint16 or amplitudes.ndim != 4 or not np.all(amplitudes.any(axis=(2, 3))):
        raise ValueError("psf_amplitude: expected 16-bit amplitudes (wavelength, height, v, u), none of them all zero")
    rows, columns = amplitudes.shape[2:]
    if columns < rows and columns == rows // 2 + 1:
        amplitudes = np.concatenate([amplitudes[..., :0:-1], amplitudes], axis=-1)
    psfs = np.empty(amplitudes.shape, np.float32)
    for psf, amplitude in zip(psfs, amplitudes, strict=True):  # one wavelength's doubles at a time
        light = amplitude / np.float64(AMPLITUDE_STEPS)
        light *= light
        np.divide(light, light.sum(axis=(1, 2), keepdims=True), out=psf, casting="same_kind")
    return psfs


def _header(contents, path):
    try:
        header = json.loads(str(contents["header"]))
        kind, version = header["format"], header["version"]
    except (KeyError, TypeError, ValueError, RecursionError):
        raise LensError(path, "header", "missing or damaged", "expected a Lensfield lens package") from None
    if (kind, version) != (FORMAT, VERSION):
        raise LensError(path, "format", f"{shown(kind)} {shown(version)}", f"expected {FORMAT} {VERSION}")
    return header
