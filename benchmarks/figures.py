"""Measurements, by name: the figures of the documents' tables.

    python benchmarks/figures.py                             # lists them
    python benchmarks/figures.py NAME --help                 # describes one, and its arguments
    python benchmarks/figures.py NAME [WORD ...] [--option VALUE ...]

Each is a function of a module next to this one, which yields lines. Its arguments are those of the command line: words,
and options for those by name only. LENSFIELD_KERNELS=numpy (or base, avx2, gpu, …) chooses the loops.
"""

import argparse
import sys
from importlib import import_module
from inspect import getdoc, signature

MODULES = {
    "bench": ("bench", "case"),
    "cost": ("cost",),
    "errors": ("accuracy", "supersampling", "sharpness", "worst"),
    "optics": ("anamorphic", "bake", "rack", "grid", "sensor"),
    "depth": ("casting", "blurred_lamps", "near_focus"),
    "adapters": ("gpu",),
    "stray": ("ghosts", "veil", "stray"),
    "processes": ("start", "memory", "large", "farm", "film"),
    "stored": ("files",),
    "captures": ("scene", "noise", "detail"),
    "devices": ("device",),
    "jobs": ("job", "projection", "preview"),
    "upsampling": ("upsampling",),  # in the environment of make tables
}
"""The measurements of each module."""


def measurement(name):
    """The function with this name."""
    module = next(module for module, names in MODULES.items() if name in names)
    return getattr(import_module(module), name)


def arguments(measure, words):
    """The positional and the named arguments of a function in the words of a command line."""
    parser = argparse.ArgumentParser(prog=f"figures.py {measure.__name__}", description=getdoc(measure),
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parameters = signature(measure).parameters.values()
    for each in parameters:
        several, option = isinstance(each.default, tuple), each.kind is each.KEYWORD_ONLY
        typical = (*each.default, "")[0] if several else each.default
        if each.default is False:
            parser.add_argument(f"--{each.name}", action="store_true")
            continue
        count = {"nargs": "+" if option else "*"} if several else {} if option else {"nargs": "?"}
        parser.add_argument(f"--{each.name.replace('_', '-')}" if option else each.name, default=each.default,
                            type=type(typical), **count)
    return vars(parser.parse_args(words))


def main(name=None, *words):
    """Print the lines of a measurement."""
    names = [each for names in MODULES.values() for each in names]
    if name not in names:
        sys.exit(f"{__doc__}\n{', '.join(names)}")
    measure = measurement(name)
    for line in measure(**arguments(measure, words)):
        print(line, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
