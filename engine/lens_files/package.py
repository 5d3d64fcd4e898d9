"""Lensfield's lens package: one .npz of arrays and a JSON header, without pickles.

PSFs are stored as 16-bit amplitudes, the square roots of their samples relative to the largest. This preserves the
precision of faint tails: storage changes a PSF by at most about 1e-4 of its light. For mirror-symmetric PSFs, only one
half is stored. The version of the header states the kind of lens: 2 for tables over heights, as in `RadialLens`, and 3
for tables over x and y, as in `GridLens`. Fields have the names that they have there.
"""

import json
from dataclasses import dataclass, fields
from io import BytesIO
from pathlib import Path

import numpy as np

from ..lens import GridLens, Lens, RadialLens
from ..runtime.build_identity import software
from ..runtime.errors import LensError, shown
from ..runtime.files import atomic_path
from ..runtime.inputs import reading
from ..runtime.versions import check_version
from .npz import read_arrays

FORMAT = "lensfield-lens"
ADDED, ADDED_SCALARS = ("point_flux",), ("central_obstruction",)  # absent from older packages
AMPLITUDE_STEPS = np.iinfo(np.uint16).max


@dataclass(frozen=True)
class Layout:
    """The fields of a kind of lens: arrays of the file, and scalars of its header."""

    kind: type[Lens]
    arrays: tuple[str, ...]

    @property
    def scalars(self) -> tuple[str, ...]:
        return tuple(field.name for field in fields(self.kind)
                     if field.name not in (*self.arrays, *ADDED, *ADDED_SCALARS, "psf", "prescription"))


LAYOUTS = {
    2: Layout(RadialLens, ("wavelengths_nm", "heights_mm", "real_height_mm", "relative_illumination",
                           "enclosed_energy", "transmittance")),
    3: Layout(GridLens, ("wavelengths_nm", "y_mm", "x_mm", "source_mm", "within", "relative_illumination",
                         "enclosed_energy", "transmittance"))}
"""By version."""
MEMBERS = ("header", *dict.fromkeys(name for layout in LAYOUTS.values() for name in layout.arrays), *ADDED,
           "psf_amplitude")


def write_package(lens: Lens, path: str | Path) -> None:
    """Write `lens` to `path`. The file appears complete or not at all.

    Examples
    --------
    >>> from lensfield import load_lens, write_package
    >>> write_package(load_lens("tessar-50mm", quality="preview", wavelengths_nm=[550]), "tessar.npz")
    >>> load_lens("tessar.npz").sensor_mm
    (36.0, 24.0)
    """
    with atomic_path(path) as temporary:
        temporary.write_bytes(package_bytes(lens))


def package_bytes(lens: Lens) -> bytes:
    """The contents of the file that `write_package` writes."""
    stream = BytesIO()
    version, layout = next(each for each in LAYOUTS.items() if isinstance(lens, each[1].kind))
    header = {"format": FORMAT, "version": version, "software": software()}
    header |= {name: getattr(lens, name) for name in (*layout.scalars, *ADDED_SCALARS)}
    arrays = {name: getattr(lens, name) for name in (*layout.arrays, *ADDED)} | {"psf_amplitude": _amplitudes(lens.psf)}
    np.savez_compressed(stream, header=np.array(json.dumps(header)), **arrays)
    return stream.getvalue()


def read_package(path: str | Path | BytesIO) -> Lens:
    """Read a lens package: a file, or its contents.

    Raises
    ------
    LensError
        The file is not a package or has another version; or a field is missing or invalid.
    """
    with reading(path):
        return _lens_of(path, _contents(path))


def _lens_of(path, contents):
    header = _header(contents, path)
    version = header["version"]
    layout = LAYOUTS[version]
    missing = [name for name in (*layout.arrays, "psf_amplitude") if name not in contents]
    missing += [name for name in layout.scalars if name not in header]
    if missing:
        raise LensError(path, missing[0], "missing", f"required in a lens package of version {version}")
    try:
        return layout.kind(**{name: header[name] for name in layout.scalars},
                           **{name: header[name] for name in ADDED_SCALARS if name in header},
                           **{name: contents[name] for name in layout.arrays},
                           **{name: contents[name] for name in ADDED if name in contents},
                           psf=_psfs(contents["psf_amplitude"], 3 + len(layout.kind.AXES)))
    except LensError as error:
        raise error.at(path) from None
    except (TypeError, ValueError) as error:
        raise LensError(path, "lens package", "damaged", str(error)) from None


def _contents(path):
    """Arrays of a package by name: the MEMBERS that it contains."""
    try:
        return read_arrays(path, MEMBERS)
    except Exception as error:  # numpy and zipfile raise a dozen kinds of errors for damaged bytes
        raise LensError(path, "lens package", "not readable", f"expected a .npz lens package ({error})") from None


def _amplitudes(psf):
    """uint16 array (wavelength, *place, v, u); only the half with u >= 0 if the other is its exact mirror image."""
    peaks = psf.max(axis=(-2, -1), keepdims=True)
    amplitudes = np.rint(AMPLITUDE_STEPS * np.sqrt(psf / peaks)).astype(np.uint16)
    mirrored = psf.shape[-1] % 2 == 1 and np.array_equal(psf, psf[..., ::-1])
    return amplitudes[..., psf.shape[-1] // 2:] if mirrored else amplitudes


def _psfs(amplitudes, dimensions):
    """PSFs of unit sum from `_amplitudes` with this number of axes."""
    if amplitudes.dtype != np.uint16 or amplitudes.ndim != dimensions or not np.all(amplitudes.any(axis=(-2, -1))):
        raise ValueError(f"psf_amplitude: expected 16-bit amplitudes with {dimensions} axes, and light in each PSF")
    rows, columns = amplitudes.shape[-2:]
    if columns < rows and columns == rows // 2 + 1:
        amplitudes = np.concatenate([amplitudes[..., :0:-1], amplitudes], axis=-1)
    psfs = np.empty(amplitudes.shape, np.float32)
    for psf, amplitude in zip(psfs, amplitudes, strict=True):  # one wavelength's doubles at a time
        light = amplitude / np.float64(AMPLITUDE_STEPS)
        light *= light
        np.divide(light, light.sum(axis=(-2, -1), keepdims=True), out=psf, casting="same_kind")
    return psfs


def _header(contents, path):
    try:
        header = json.loads(str(contents["header"]))
        kind, version = header["format"], header["version"]
    except (KeyError, TypeError, ValueError, RecursionError):
        raise LensError(path, "header", "missing or damaged", "expected a Lensfield lens package") from None
    if kind != FORMAT:
        raise LensError(path, "format", shown(kind), f"expected {FORMAT}")
    check_version(path, version, LAYOUTS, LensError)
    return header
