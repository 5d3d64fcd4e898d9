"""Settings: fields with their texts and limits.

A setting is defined once, at its field. Panels, command lines, records of finished frames and error messages take it
from there.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from .errors import InputError

T = TypeVar("T")


@dataclass(frozen=True)
class Setting:
    """How users set a field, and whether a finished frame depends on it.

    Attributes
    ----------
    name : str
        Label in panels.
    text : str
        Tooltip in panels, and help on the command line.
    default : object
        Default of the field.
    kind : type
        Of a single value: bool, int, float, str or Path.
    choices : mapping of str to (str, str)
        Label and text of each value; empty if any value of `kind` is valid.
    limits, soft_limits : (float, float) or None
        Minimum and maximum of the value, and of its slider. None for no limits.
    precision : int or None
        Decimals that panels show.
    subtype : str
        Blender's subtype of the property, such as "FACTOR" or "PIXEL".
    panel : str or None
        Part of the panel that lists it; "" for a setting with a fixed place in the panel, None without a Blender
        property.
    panel_default : object
        Default of the Blender property, if it differs from the default of the field.
    owner : str
        Data-block with the property in Blender: "scene" or "camera".
    option : str or None
        Its option on the command line without the dashes; "" for the field's name, None without an option.
    metavar : str or None
        Placeholder for the value in the help of the command line. With choices, it means that other values can be
        valid, too.
    several : bool
        Whether the value is any number of the choices, separated by commas: a set in Blender.
    unset : str
        The value that applies without the option, in words for its help.
    recorded : bool
        Whether finished frames depend on it: they are rendered again when it changes. False also for fields that
        determine the lens, because records contain the lens's digest.
    """

    name: str
    text: str
    default: Any = None
    kind: type = str
    choices: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    limits: tuple[float, float] | None = None
    soft_limits: tuple[float, float] | None = None
    precision: int | None = None
    subtype: str = "NONE"
    panel: str | None = None
    panel_default: Any = None
    owner: str = "scene"
    option: str | None = ""
    metavar: str | None = None
    several: bool = False
    unset: str = ""
    recorded: bool = True

    @property
    def choices_text(self) -> str:
        """Text of all choices, in one line."""
        return "; ".join(f"{value}: {text}" for value, (_, text) in self.choices.items() if text)


def setting(default: Any, **of_setting: Any) -> Any:
    """A dataclass field with a `Setting`, whose other attributes are keyword arguments."""
    return field(default=default, metadata={"setting": Setting(default=default, **of_setting)})


def settings_of(owner: Any) -> dict[str, Setting]:
    """The settings of a dataclass or of an instance, by field name, in the order of the fields."""
    return {each.name: each.metadata["setting"] for each in fields(owner) if "setting" in each.metadata}


def option_of(name: str, each: Setting) -> str:
    """The option that sets a field on the command line, without the dashes."""
    return each.option or name.replace("_", "-")


def check_choices(value: Any) -> None:
    """Raise an InputError for the first setting of a dataclass value that is neither its default nor a choice."""
    for name, each in settings_of(value).items():
        chosen = getattr(value, name)
        if each.several:
            _check_listed(name, chosen, each.choices)
        elif each.choices and not each.metavar and chosen not in (*each.choices, each.default):
            raise InputError("options", name, chosen, f"expected {' or '.join(each.choices)}")


def _check_listed(name: str, chosen: str, choices: Mapping[str, tuple[str, str]]) -> None:
    for word in chosen.split(",") if chosen else ():
        if word not in choices:
            raise InputError("options", name, word or "empty",
                             f"expected some of {', '.join(choices)}, separated by commas")


def documented(owner: type[T]) -> type[T]:
    """Append the text of each setting of a dataclass to its docstring, as numpydoc attributes."""
    lines = ["Attributes", "----------"]
    for name, each in settings_of(owner).items():
        lines += [name, *(f"    {line}" for line in filter(None, (f"{each.text}.", each.choices_text)))]
    owner.__doc__ = "\n    ".join([f"{(owner.__doc__ or '').rstrip()}\n", *lines])
    return owner
