"""The library of loops: found, loaded and asked what this machine can run; and how arrays are handed to it."""

import ctypes
import os
import struct
import warnings
from ctypes import POINTER, Structure, c_char_p, c_double, c_float, c_int, c_int64, c_void_p
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import DTypeLike

from ..errors import InputError
from .build import LIBRARY_FOLDER, library_name, sources_digest, this_platform

ABI = 5  # that of kernels.h
NUMPY = "numpy"
VARIABLE = "LENSFIELD_KERNELS"
PROBLEMS = {1: "a sample lies outside of the square", 2: "sizes that cannot be"}


def _structure(name, **fields):
    return type(name, (Structure,), {"_fields_": list(fields.items())})


# The structures of kernels.h, field by field.
PICTURE = _structure("Picture", values=c_void_p, planes=c_int64, rows=c_int64, columns=c_int64, plane_step=c_int64,
                     row_step=c_int64)
PLACES = _structure("Places", centre_row=c_double, centre_column=c_double, samples_per_px=c_double, paraxial=c_void_p,
                    interval=c_void_p, height=c_void_p, samples=c_int64, heights=c_int64, azimuths=c_int64,
                    quarter_steps=c_int64)
TABLE = _structure("Table", taps=c_void_p, size=c_int64, side=c_int64, intervals=c_int64, begin=c_void_p,
                   length=c_void_p, first_piece=c_void_p, counts=c_void_p, row=c_void_p, column=c_void_p,
                   pieces=c_int64)
SECTIONS = _structure("Sections", lit=c_void_p, rows=c_int64, columns=c_int64, size_px=c_int64)
GEOMETRY = _structure("Geometry", centre_row=c_double, centre_column=c_double, samples_per_px=c_double,
                      curves=c_void_p, samples=c_int64, last_px=c_double)
CAPTURE = _structure("Capture", first=c_void_p * 4, row_step=c_int64 * 4, step=c_int64 * 4, planes=c_int64,
                     rows=c_int64, columns=c_int64, centre_row=c_double, centre_column=c_double)
SAMPLES = _structure("Samples", v_px=c_void_p, u_px=c_void_p, energy=c_void_p, count=c_int64, heights=c_int64,
                     size_px=c_double)
WAVEFRONT = _structure("Wavefront", across=c_void_p, up=c_void_p, path=c_void_p, edges=c_void_p, rows=c_int64,
                       columns=c_int64, path_terms=c_int64, edge_terms=c_int64, limits=c_int64, least=c_float,
                       most=c_float)
LAYER = _structure("Layer", light=PICTURE, alpha=c_void_p, depth=c_void_p, axis_row=c_float, axis_column=c_float,
                   top=c_float, bottom=c_float, left=c_float, right=c_float)
CAST = _structure("Cast", rays=c_void_p, heights=c_int64, eights=c_int64, wavelengths=c_int64,
                  centre_row=c_double, centre_column=c_double, heights_per_px=c_double, per_focal=c_float,
                  normals=c_void_p, blades=c_int64, blade_margin=c_float, blade_bend=c_float, blade_slope=c_float,
                  layer=POINTER(LAYER), layers=c_int64, faint=c_float * 6, meetings=c_void_p, tile_eights=c_void_p,
                  tile_rows=c_int64, tile_columns=c_int64, tile_px=c_int64)

_SIGNATURES = {
    "lf_abi": (c_int, []),
    "lf_sources": (c_char_p, []),
    "lf_variant": (c_char_p, [c_int]),
    "lf_runs_here": (c_int, [c_int]),
    "lf_spread_work": (c_int64, [c_int64, c_int64]),
    "lf_spread": (c_int, [c_int, *map(POINTER, (PLACES, TABLE, PICTURE, SECTIONS)), c_int64, c_int64, POINTER(PICTURE),
                          c_void_p]),
    "lf_footprints": (c_int, [c_int, POINTER(GEOMETRY), POINTER(CAPTURE), c_int64, c_int64, POINTER(PICTURE)]),
    "lf_turn": (c_int, [c_int, POINTER(SAMPLES), c_double, c_double, c_int64, c_void_p]),
    "lf_waves": (c_int, [c_int, POINTER(WAVEFRONT), POINTER(PICTURE), c_void_p, c_void_p]),
    "lf_cast": (c_int, [c_int, POINTER(CAST), c_int64, c_int64, POINTER(PICTURE), POINTER(PICTURE), c_void_p]),
}


@dataclass(frozen=True)
class Library:
    """A library that is loaded, and the numbers of the variants in it that run here, by name, the simplest first."""

    loops: ctypes.CDLL
    variants: dict[str, int]


@cache
def loaded() -> Library | None:
    """The library of this machine, or None where there is none that fits."""
    path = LIBRARY_FOLDER / library_name(this_platform())
    try:
        _refuse_part(path)
        loops = ctypes.CDLL(str(path))
        for name, (result, arguments) in _SIGNATURES.items():
            function = getattr(loops, name)
            function.restype, function.argtypes = result, arguments
        fits = loops.lf_abi() == ABI and sources_digest() in ("", loops.lf_sources().decode())
    except (OSError, AttributeError) as problem:
        if path.exists():
            _tell(path, f"cannot be loaded ({problem}): numpy does its work")
        return None
    if not fits:
        _tell(path, "was made from other sources: numpy does its work until engine/kernels/build.py is run")
        return None
    variants = {}
    while name := loops.lf_variant(number := len(variants)):
        if not loops.lf_runs_here(number):
            break
        variants[name.decode()] = number
    return Library(loops, variants)


def _refuse_part(path):
    """Raise OSError for a library that a full disk or a broken download cut short: on Linux, loading it is a bus error.

    What an ELF file ends with is the table of its sections; where that is, how large and how many, its header tells.
    """
    content = path.read_bytes()
    if content[:4] == b"\x7fELF":
        table, size, count = struct.unpack_from("<40xQ10xHH", content.ljust(64, b"\0"))
        if len(content) < table + size * count:
            raise OSError("a part of it is missing")


def _tell(path, text):
    """One line: there is no line of code to show beside it."""
    warnings.warn_explicit(text, RuntimeWarning, str(path), 0)


def available() -> tuple[str, ...]:
    """What can do the loops on this machine, the slowest first: "numpy" always."""
    library = loaded()
    return (NUMPY, *(library.variants if library else ()))


def running() -> str:
    """What does the loops: the quickest that is available, or what the variable LENSFIELD_KERNELS names.

    Raises
    ------
    InputError
        Where this is not available.
    """
    asked = os.environ.get(VARIABLE)
    if asked and asked not in available():
        raise InputError("environment", VARIABLE, asked, f"this machine has {', '.join(available())}")
    return asked or available()[-1]


def chosen() -> tuple[ctypes.CDLL, int]:
    """The library's functions, and the number of the variant of them that is `running`, which must not be numpy."""
    library = loaded()
    assert library, "there is no library: ask running() before"
    return library.loops, library.variants[running()]


def check(problem: int) -> None:
    """Raise ValueError where a loop says that something is wrong with its arguments."""
    if problem:
        raise ValueError(PROBLEMS[problem])


def address(array: np.ndarray, dtype: DTypeLike, shape: tuple[int, ...] | None = None) -> int:
    """Where an array lies, which has to be of this kind and shape, and without gaps. Keep it as long as this is used.

    Raises
    ------
    ValueError
    """
    fits = array.dtype == dtype and array.flags.c_contiguous and array.flags.aligned
    if not fits or shape not in (None, array.shape):
        raise ValueError(f"a {array.dtype} array of shape {array.shape} and strides {array.strides}, where the loops "
                         f"want {np.dtype(dtype)} without gaps" + (f" of shape {shape}" if shape else ""))
    return array.ctypes.data


def picture(array: np.ndarray) -> Structure:
    """A float32 array (plane, row, column), whose rows have no gaps within, as the loops take it.

    Raises
    ------
    ValueError
    """
    fits = array.ndim == 3 and array.dtype == np.float32 and array.flags.aligned
    if not fits or (array.strides[2] != 4 and array.shape[2] > 1 and array.size):
        raise ValueError(f"a {array.dtype} array of shape {array.shape} and strides {array.strides}, where the loops "
                         "want float32 (plane, row, column) with rows in one piece")
    return PICTURE(array.ctypes.data, *array.shape, array.strides[0] // 4, array.strides[1] // 4)
