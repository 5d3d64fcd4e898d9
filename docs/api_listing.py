"""The record of the public API in docs/api.md: names with their signatures, options of the command line, file formats,
and Blender's properties and operators, as the code defines them.

    python docs/api_listing.py

rewrites the listings in the page, in a Python with Blender's wheel. `tests/test_api.py` compares them with the code: a
change of the API is thereby deliberate, and belongs into the changelog.
"""

import argparse
import inspect
import re
import textwrap
from contextlib import redirect_stdout, suppress
from dataclasses import is_dataclass
from importlib import import_module
from io import StringIO
from pathlib import Path

import lensfield
from lensfield import cli
from lensfield.engine.pictures import spectral_exr

PAGE = Path(__file__).with_name("api.md")
REFERENCE = PAGE.parent / "site" / "api.rst"
MEMBERS = re.compile(r"^\.\. autoclass:: (\w+).*\n +:members: (.*)$", re.MULTILINE)
LISTING = re.compile(r"(<!-- listing: (\w+) -->\n+```text\n).*?(\n```)", re.DOTALL)
DEFAULT = re.compile(r"\(default: ([^)]*(?:\([^)]*\))?[^)]*)\)$")
OF_ADDON = ("RenderRequest", "apply_lens", "plan_comparison", "preflight", "register", "render_animation",
            "render_comparison", "render_dataset", "render_through_lens", "source_digest", "unregister")
"""The names of `lensfield.addon` for scripts. The command uses its other names."""
OPERATORS = ("add_camera", "apply_lens", "compare", "fit_lens", "lint", "match_camera", "open_lens", "quick_look",
             "remove_from_compositor", "remove_quick_look", "render", "render_animation", "write_lens_assets")
"""The operators for scripts. The others are buttons of panels."""
OF_THE_WINDOW = {"--blend-folder", "--changes", "--moves", "--scene-source", "--scene-state", "--session",
                 "--view-settings"}
"""Options that Blender's window passes to the process that it starts, which is of the same build."""
FORMATS = {"engine.lens_files.package": "lens packages (.npz)",
           "engine.prescription.readers.toml": "prescriptions (.toml)",
           "engine.sensor.camera_file": "cameras (.toml)", "engine.sensor.film": "film (.toml)",
           "engine.lens_files.export": "folders that the export macros write (lens.toml)",
           "engine.pictures.frame_record": "records of finished frames (..._report.json)",
           "engine.simulation.report": "reports (--report FILE.json)",
           "addon.render.dataset_index": "indexes of datasets (index.jsonl)"}
"""The purpose of each FORMAT, by its module."""
SIMPLE = bool, int, float, str, type(None)
WIDTH = 118


def python():
    """The names of `lensfield` with their signatures, and the members that the reference lists."""
    members = dict(MEMBERS.findall(REFERENCE.read_text(encoding="utf-8")))
    return [line for name in lensfield.__all__
            for line in _lines_of(name, getattr(lensfield, name), filter(None, members.get(name, "").split(", ")))]


def command():
    """Every subcommand of `lensfield` with its arguments; and each option with its choices and its default, followed by
    the subcommands that take it."""
    commands = {" ".join(words): _actions(parser) for words, parser in _parsers(["lensfield"], cli._parser())}
    takers = {}
    for name, actions in commands.items():
        for action in actions:
            if action.option_strings:
                takers.setdefault(_option(action), []).append(name.removeprefix("lensfield "))
    usages = [" ".join([name, *(_values(action) for action in actions if not action.option_strings)])
              for name, actions in commands.items() if actions]
    return [*usages, "", *(line for option in sorted(takers)
                           for line in (option, *_wrapped(", ".join(takers[option]), "    ", "    ")))]


def formats():
    """The names of file formats, as files state them, and their versions."""
    modules = {import_module(f"lensfield.{name}"): text for name, text in FORMATS.items()}
    lines = {each.FORMAT: (getattr(each, "LAYOUTS", None) or [each.VERSION], text) for each, text in modules.items()}
    lines["lensfield:version"] = [spectral_exr.VERSION], "spectral pictures (.exr)"
    return [f"{name:23}{', '.join(map(str, versions)):6}{text}" for name, (versions, text) in lines.items()]


def blender():
    """Names of `lensfield.addon`, properties of data-blocks, and operators."""
    from lensfield import addon

    return [*(line for name in OF_ADDON for line in _lines_of(f"addon.{name}", getattr(addon, name), ())), "",
            *_properties(), "", *_operators()]


def _lines_of(name, value, members):
    """A function or a class, and these of its methods and properties."""
    yield from _wrapped(f"{name}{_signature(value)}")
    for member in members:
        found = getattr(value, member)
        call = _signature(found).replace("(self, ", "(").replace("(self)", "()") if callable(found) else ""
        yield from _wrapped(f"    .{member}{call}")


def _wrapped(text, first="", others="        "):
    return textwrap.wrap(text, WIDTH, initial_indent=first, subsequent_indent=others, break_long_words=False,
                         break_on_hyphens=False, drop_whitespace=True) if len(text) > WIDTH or first else [text]


def _signature(value):
    """Names, order, kinds and defaults of arguments, without types."""
    arguments = [each.replace(annotation=each.empty, default=_Default(each.default))
                 if each.default is not each.empty else each.replace(annotation=each.empty)
                 for each in inspect.signature(value).parameters.values() if not each.name.startswith("_")]
    return str(inspect.Signature(arguments))


class _Default:
    """A default whose text is the same on every machine: "..." for functions, arrays and computed values."""

    def __init__(self, value):
        self._value = value

    def __repr__(self):
        value = self._value
        if isinstance(value, tuple) and all(isinstance(each, SIMPLE) for each in value):
            return repr(value) if len(value) < 8 else "..."
        if is_dataclass(value):
            return f"{type(value).__name__}()"
        return repr(value) if isinstance(value, SIMPLE) else "..."


def _parsers(words, parser):
    """(words, parser) of each command, whose modules are imported."""
    with redirect_stdout(StringIO()), suppress(SystemExit):
        parser.parse_args(["--help"])
    groups = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    yield words, parser
    for group in groups:
        for name, inner in group.choices.items():
            yield from _parsers([*words, name], inner)


def _actions(parser):
    """The arguments and options of a parser itself."""
    return [action for action in parser._actions if not OF_THE_WINDOW & {*action.option_strings}
            and not isinstance(action, argparse._HelpAction | argparse._SubParsersAction)]


def _option(action):
    words = ", ".join(action.option_strings)
    required = "(required)" if action.required else _default(action)
    return "  ".join(filter(None, (" ".join(filter(None, (words, _values(action)))), required)))


def _values(action):
    """The placeholders of an action's values, or its choices."""
    if action.nargs == 0:
        return ""
    name = f"{{{','.join(map(str, action.choices))}}}" if action.choices else action.metavar or action.dest.upper()
    if isinstance(name, tuple):
        return " ".join(name)
    more = {"?": f"[{name}]", "*": f"[{name} ...]", "+": f"{name} ..."}
    return more.get(action.nargs, " ".join([name] * (action.nargs or 1) if isinstance(action.nargs, int) else [name]))


def _default(action):
    """The default of an option: as its help states it, or as the parser does."""
    stated = DEFAULT.search(action.help or "")
    if stated:
        return f"default: {stated[1]}".replace("%%", "%").replace("%(default)s", str(action.default))
    return "" if action.default in (None, False, argparse.SUPPRESS) else f"default: {action.default}"


def _properties():
    from lensfield.addon.ui.common.properties import _OWNERS

    for owner, group in _OWNERS:
        for name, each in sorted(group.__annotations__.items()):
            if "HIDDEN" not in each.keywords.get("options", ()):
                yield from _wrapped(f"{owner.__name__}.lensfield.{name}{_value(each)}")


def _operators():
    from lensfield.addon import _CLASSES

    classes = {getattr(cls, "bl_idname", ""): cls for cls in _CLASSES}
    for name in OPERATORS:
        settings = getattr(classes[f"lensfield.{name}"], "__annotations__", {})
        yield f"bpy.ops.lensfield.{name}()"
        yield from (f"    {name}{_value(each)}" for name, each in settings.items() if not name.startswith("filter_"))


def _value(each):
    """The default and the choices of a Blender property."""
    items, default = each.keywords.get("items"), each.keywords.get("default")
    choices = f" of {', '.join(item[0] for item in items)}" if items and not callable(items) else ""
    default = sorted(default) if isinstance(default, set) else default
    return f" = {default!r}{choices}" if default is not None and not callable(items) else choices


def with_listings(text):
    """The page's text with up-to-date listings."""
    return LISTING.sub(lambda match: match[1] + "\n".join(globals()[match[2]]()) + match[3], text)


if __name__ == "__main__":
    PAGE.write_text(with_listings(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
