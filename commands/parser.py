"""The parser of the `lensfield` command line, with all subcommands."""

import argparse

from ..engine.kernels import running
from ..engine.runtime.build_identity import build_identity
from ..engine.runtime.errors import InputError
from . import apply, farm, filter, lens, lint, render, serve, tradeoff


class _Version(argparse.Action):
    def __call__(self, parser, *_):
        try:
            print(f"lensfield {self.const}, build {build_identity()} (inner loops: {running()})")
        except InputError as error:
            parser.error(str(error))
        parser.exit()


def command_parser(main, version):
    """The parser for a version of Lensfield; `serve` runs commands through `main(arguments)`."""
    parser = argparse.ArgumentParser(prog="lensfield", description="Render Blender scenes through real lenses.")
    parser.add_argument("--version", action=_Version, const=version, nargs=0,
                        help="print the version, the build, and whether the inner loops run in C or numpy")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in (render, apply, filter, tradeoff, lens, lint, farm):
        command.add(commands)
    serve.add(commands, main)
    return parser
