"""The parser of the `lensfield` command line, with all subcommands."""

import argparse
from importlib import import_module

LONGEST_LINE = 1000  # characters of an error message, including the system's
USAGE_ERROR = 2  # exit status
COMMANDS = {
    "render": "render a .blend multispectrally and through a lens",
    "preview": "show a .blend through a lens, first coarsely, then more and more finely",
    "apply": "apply another lens to a finished render",
    "compare": "put one capture of a .blend through several lenses: a labelled contact sheet",
    "dataset": "render frames of a .blend through several lenses, with calibrations, ground truth and an index",
    "filter": "put an EXR or a sequence of them through a lens: spectral radiance, or any renderer's RGB",
    "develop": "take a picture of a lens image with a camera: a DNG, a PNG, linear EXRs",
    "coco": "write boxes and masks of the objects in renders, in the layout of COCO",
    "tradeoff": "measure error against time and memory: a table and a plot",
    "lens": "list, inspect, check, plot, bake and convert lenses",
    "camera": "list and inspect cameras",
    "lint": "check how a .blend would be rendered; exit status 1 if it would be refused",
    "farm": "write a render as a job for render farms",
    "serve": "run commands from standard input, for other programs",
}
"""The help text of each subcommand, by the name of its module."""


def command_parser(main, version):
    """The parser for a version of Lensfield; `serve` runs commands through `main(arguments)`."""
    parser = _Parser(prog="lensfield", description="Render Blender scenes through real lenses.")
    parser.add_argument("--version", action=_Version, const=version, nargs=0,
                        help="print the version, the build, whether the inner loops run in C, numpy or on a GPU, and "
                             "the versions of Python, the system, Blender and packages, for reports of errors")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Subcommand)
    for name, text in COMMANDS.items():
        commands.add_parser(name, help=text, module=name)
    commands.choices["serve"].set_defaults(main=main)
    return parser


class _Parser(argparse.ArgumentParser):
    """A parser that reports a usage error in one line, as commands report all bad input."""

    def error(self, message):
        self.refuse(message, f"; see {self.prog} --help")

    def refuse(self, message, advice=""):
        """Exit after a line on bad input."""
        from lensfield.engine.runtime.errors import shown

        self.exit(USAGE_ERROR, f"{shown(f'{self.prog}: {message}', LONGEST_LINE)}{advice}\n")


class _Subcommand(_Parser):
    """The parser of a subcommand. It imports the subcommand's module and adds its options when it is first used."""

    def __init__(self, module=None, **settings):
        super().__init__(**settings, allow_abbrev=False)  # a new option must not change a script's meaning
        self._module = module

    def parse_known_args(self, args=None, namespace=None):
        if self._module:
            module, self._module = import_module(f".{self._module}", __package__), None
            module.add_options(self)
        options, unknown = super().parse_known_args(args, namespace)
        if unknown:  # here, where the subcommand is known
            self.error(f"unknown arguments: {' '.join(unknown)}")
        return options, unknown


class _Version(argparse.Action):
    def __call__(self, parser, *_):
        from lensfield.engine.kernels.gpu import usable_gpu
        from lensfield.engine.kernels.library import running
        from lensfield.engine.runtime.build_identity import build_identity
        from lensfield.engine.runtime.errors import InputError

        from .surroundings import surroundings

        try:
            loops, gpu = running(), usable_gpu()
            on_gpu = f"; casting, filter: {gpu.name}" if gpu else ""
            print(f"lensfield {self.const}, build {build_identity()} (inner loops: {loops}{on_gpu})", surroundings(),
                  sep="\n")
        except InputError as error:
            parser.refuse(error)
        parser.exit()
