"""Load the library of loops, and choose the variant that this machine can run."""

import ctypes
import os
import struct
import warnings
from dataclasses import dataclass
from functools import cache

from ..runtime.errors import InputError
from .build import LIBRARY_FOLDER, library_name, sources_digest, this_platform
from .declarations import FUNCTIONS, NUMBERS
from .gpu import GPU, VARIABLE, missing, usable_gpu

ABI = NUMBERS["ABI"]
NUMPY = "numpy"
_without_gpu: list[str] = []  # the value of the variable that `use_gpu` has set
PROBLEMS = {1: "a sample is outside the square", 2: "invalid sizes"}


@dataclass(frozen=True)
class Library:
    """A loaded library, and the index of each variant that runs on this machine, by name, the simplest first."""

    loops: ctypes.CDLL
    variants: dict[str, int]


@cache
def loaded() -> Library | None:
    """The library for this machine, or None if a suitable one is missing."""
    path = LIBRARY_FOLDER / library_name(this_platform())
    try:
        _refuse_part(path)
        loops = ctypes.CDLL(str(path))
        for name, (result, arguments) in FUNCTIONS.items():
            function = getattr(loops, name)
            function.restype, function.argtypes = result, arguments
        fits = loops.lf_abi() == ABI and sources_digest() in ("", loops.lf_sources().decode())
    except (OSError, AttributeError) as problem:
        if path.exists():
            _warn(path, f"cannot be loaded ({problem}): numpy is used instead")
        return None
    if not fits:
        _warn(path, "was built from other sources: numpy is used until you run engine/kernels/build.py")
        return None
    variants = {}
    while name := loops.lf_variant(number := len(variants)):
        if not loops.lf_runs_here(number):
            break
        variants[name.decode()] = number
    return Library(loops, variants)


def _refuse_part(path):
    """Raise OSError for a library truncated by a full disk or a broken download: on Linux, loading it is a bus error.

    An ELF file ends with its table of sections. The header contains the table's offset, entry size and length.
    """
    content = path.read_bytes()
    if content[:4] == b"\x7fELF":
        table, size, count = struct.unpack_from("<40xQ10xHH", content.ljust(64, b"\0"))
        if len(content) < table + size * count:
            raise OSError("the file is truncated")


def _warn(path, text):
    """Warn in one line, without a line of code."""
    warnings.warn_explicit(text, RuntimeWarning, str(path), 0)


def available() -> tuple[str, ...]:
    """Implementations of the loops that run on this machine, the slowest first; always includes "numpy"."""
    library = loaded()
    return (NUMPY, *(library.variants if library else ()))


def running() -> str:
    """The implementation in use: the fastest available, or the one that the variable LENSFIELD_KERNELS names.

    If the variable is "gpu", this is the fastest, for everything except `cast_tiles` and `spread_picture`.

    Raises
    ------
    InputError
        If this is not available.
    """
    requested = os.environ.get(VARIABLE)
    if requested == GPU:
        if lacking := missing():
            raise InputError("environment", VARIABLE, requested, lacking)
        requested = None
    if requested and requested not in available():
        raise InputError("environment", VARIABLE, requested, f"this machine has {', '.join(available())}")
    return requested or available()[-1]


def on_processor() -> str:
    """The kind of loops in use without a graphics processor: "C", whose variants give the same bits, or "numpy".

    Raises
    ------
    InputError
        As `running`.
    """
    return NUMPY if running() == NUMPY else "C"


def caster() -> str:
    """What casts: the name of a graphics processor, or `on_processor`.

    Raises
    ------
    InputError
        As `running`.
    """
    loops, gpu = on_processor(), usable_gpu()
    return gpu.name if gpu else loops


def use_gpu(allowed: bool) -> None:
    """Let this process and those that it starts use a graphics processor, or not.

    A value that LENSFIELD_KERNELS has from elsewhere takes precedence.
    """
    if not allowed and not os.environ.get(VARIABLE):
        os.environ[VARIABLE] = running()
        _without_gpu.append(os.environ[VARIABLE])
    elif allowed and os.environ.get(VARIABLE) in _without_gpu:
        del os.environ[VARIABLE]
        _without_gpu.clear()


def chosen() -> tuple[ctypes.CDLL, int]:
    """The library's functions, and the index of the variant that is `running`, which must not be numpy."""
    library = loaded()
    assert library, "no library is loaded: check running() first"
    return library.loops, library.variants[running()]


def check(problem: int) -> None:
    """Raise ValueError if a loop returned an error code for its arguments."""
    if problem:
        raise ValueError(PROBLEMS[problem])
