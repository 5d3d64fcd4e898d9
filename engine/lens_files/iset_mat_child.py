"""Convert the ray-trace part of an ISETCam .mat into numpy arrays; a program that runs in a separate process.

scipy's reader crashes on damaged files and would take Blender with it.
Usage: iset_mat_child.py IN.mat OUT.npz BYTES, the limit for the memory of the reader.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat

PARTS = ("psf", "geometry", "relIllum")
DEPTH = 3


def main(source: str, target: str, memory_bytes: str) -> None:
    """Write every number and string of the ray-trace structure, named as in MATLAB."""
    _limit_memory(int(memory_bytes))
    ray_trace = _find(loadmat(source, squeeze_me=True, struct_as_record=False), DEPTH)
    if ray_trace is None:
        sys.exit("no ray-trace structure (psf, geometry, relIllum) in it")
    np.savez(target, **dict(_leaves(ray_trace, "")))


def _limit_memory(more_bytes):
    """Limit this process's memory, because a damaged file may demand any amount; on systems that support it.

    A lower existing limit stays.
    """
    try:
        import resource

        taken = resource.getpagesize() * int(Path("/proc/self/statm").read_text().split()[0])
    except (ImportError, OSError):
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    if soft == resource.RLIM_INFINITY or taken + more_bytes < soft:
        resource.setrlimit(resource.RLIMIT_AS, (taken + more_bytes, hard))


def _children(value):
    names = getattr(value, "_fieldnames", None)
    if names is not None:
        return {name: getattr(value, name) for name in names}
    return value if isinstance(value, dict) else {}


def _find(value, depth):
    """The structure that contains the three parts, at most this many levels down."""
    children = _children(value)
    if all(part in children for part in PARTS):
        return value
    structures = (_find(child, depth - 1) for child in children.values() if depth)
    return next((structure for structure in structures if structure is not None), None)


def _leaves(value, prefix):
    for name, child in _children(value).items():
        if _children(child):
            yield from _leaves(child, f"{prefix}{name}.")
        elif np.asarray(child).dtype.kind in "fiubU":
            yield f"{prefix}{name}", np.asarray(child)


if __name__ == "__main__":
    main(*sys.argv[1:])
