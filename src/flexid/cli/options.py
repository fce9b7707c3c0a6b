"""Options of the command line: the format of their values, and the conversion of them."""

import inspect
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

import click

from flexid.errors import SettingError
from flexid.models.flexible_joint import SHAPE_TERMS, TERMS
from flexid.readers.formats import kinds

_Value = TypeVar("_Value")

_UNCERTAIN = re.compile(r"(.+?)(?:±|\+/?-)(.+)")


def typed_name(parameter: click.Parameter) -> str:
    """Return the name of an option or argument as the help shows it."""
    return parameter.opts[0] if isinstance(parameter, click.Option) else f"{parameter.metavar}"


class Option(NamedTuple):
    """Format of a parameter of a public function on the command line."""

    kind: Callable[[str], Any]  # type that click parses
    metavar: str | None = None  # None: the choices in the parameter's documentation
    convert: Callable[[str, Any], Any] | None = None  # conversion to the type of the parameter
    note: str = ""  # text of the help after the parameter's documentation
    several: bool = False  # whether it may be given more than once

    def converted(self, _ctx: click.Context, parameter: click.Parameter, value: Any) -> Any:
        """Return the value for the public function; None or empty if not given."""
        if self.convert is None or value in (None, ()):
            return value
        return self.convert(typed_name(parameter), value)


def parse_path(option: str, value: Any) -> Any:
    """Return one or several paths as typed; raise for an empty one, the working folder."""
    if not all(path.strip() for path in ([value] if isinstance(value, str) else value)):
        raise SettingError(option, "its name is empty: give one")
    return value


def parse_number(option: str, text: str) -> float | Literal["auto"]:
    """Return a number, or ``auto``."""
    if text == "auto":
        return "auto"
    try:
        return float(text)
    except ValueError:
        raise SettingError(option, f"{text!r} is neither a number nor auto") from None


def parse_percent(text: str) -> float:
    """Return a fit in per cent; raise if it is above 100."""
    if not float(text) <= 100.0:
        raise SettingError("--min-fit", f"must be 100 % or less, got {text}")
    return float(text)


def _uncertain(text: str) -> float | tuple[float, float]:
    parts = _UNCERTAIN.fullmatch(text)
    return (float(parts[1]), float(parts[2])) if parts else float(text)


def _ends(text: str) -> tuple[float, float]:
    lower, colon, upper = text.partition(":")
    if not colon:
        raise ValueError
    return float(lower or "-inf"), float(upper or "inf")


def _number(text: str) -> float:
    """Return a number, as int if whole: a seed may have more digits than a float."""
    try:
        return int(text)
    except ValueError:
        return float(text)


def _assignments(
    value: Callable[[str], _Value], wanted: str
) -> Callable[[str, Iterable[str]], dict[str, _Value]]:
    """Return a function that parses the NAME=VALUE texts of an option into a dict."""

    def parse(option: str, assignments: Iterable[str]) -> dict[str, _Value]:
        found: dict[str, _Value] = {}
        for assignment in assignments:
            name, _, text = (part.strip() for part in assignment.partition("="))
            if name in found:
                raise SettingError(option, f"{name} is given twice: leave one of them out")
            try:
                found[name] = value(text)
            except ValueError:
                raise SettingError(option, f"{assignment!r} is not {wanted}") from None
        return found

    return parse


parse_known = _assignments(_uncertain, "name=number, e.g. beta1=3 or beta1=3+-0.1")
parse_bounds = _assignments(_ends, "name=lower:upper, e.g. theta2=50:200 or alpha2=0:")
parse_values = _assignments(_number, "path=number, e.g. controller.k=30")


def _pairs(metavar: str, parse: Callable[[str, Any], Any], note: str = "") -> Option:
    """Return an option that may be given once for each name."""
    return Option(str, metavar, parse, f"{note} May be repeated.".strip(), several=True)


_FILE = Option(str, "FILE", parse_path)
OUT = Option(str, "DIR", lambda name, path: Path(parse_path(name, path)))
_NAMES = ", ".join((*TERMS, *SHAPE_TERMS))
_TERMS = Option(str, "NAMES", note=f"Names, separated by commas: {_NAMES}.")

ARGUMENTS = {
    "log": Option(str, "LOG", parse_path),
    "logs": Option(
        str, "LOG", parse_path, f"Files: {kinds()}; - for CSV from standard input.", several=True
    ),
    "what": Option(str, "ESTIMATE|MODEL", parse_path),
}
"""Arguments (without a name), by parameter; any other argument is a path."""

OPTIONS = {
    "AutoNumber": Option(str, "SECONDS", parse_number),
    "Bounds": _pairs(
        "NAME=LOW:HIGH",
        parse_bounds,
        "For example joint_stiffness=50:200 or motor_viscous_friction=0:.",
    ),
    "Columns": _FILE,
    "FilePath": _FILE,
    "Iterable[str]": _TERMS,
    "Known": _pairs(
        "NAME=VALUE", parse_known, "For example motor_inertia=0.3 or joint_stiffness=100+-5."
    ),
    "Mapping[str, float]": _pairs("PATH=VALUE", parse_values, "For example controller.k=30."),
    "OneLog": _FILE,
    "Terms": _TERMS,
    "bool": Option(bool),
    "float": Option(float, "SECONDS"),
    "int": Option(int, "NUMBER"),
}
"""Options by the annotation of their parameter; any other option is a text."""

_METAVARS = {
    "coulomb_velocity": "VELOCITY",
    "filter_rate": "1/S",
    "header": "NAMES",
    "out": "DIR",
    "scheduler": "ADDRESS",
    "summary": "DIR",
    "validation_share": "SHARE",
}
"""Placeholder of the value in the help, by parameter, for values that differ in kind."""

FLAGS = {
    "strict": Option(bool, note="Exit with status 1 also if a value is weak."),
    "explain": Option(bool, note="Print the evidence for every choice."),
    "csv": Option(bool, note="Also write the time series as CSV; needs --out."),
    "min_fit": Option(
        parse_percent,
        "PERCENT",
        note="Exit with status 1 if the fit of the free run is lower in a channel.",
    ),
    "json": Option(bool, note="Print JSON instead of tables."),
}
"""Options on the output, which the public functions do not have."""


def sentences(text: str) -> str:
    """Return the sentences of a docstring without backquotes, which mark Python names."""
    parts = re.split(r"(?<=\.) +(?=[A-Z`])", " ".join(text.split()))
    return " ".join(part for part in parts if "`" not in part)


class Argument(click.Argument):
    """Argument of a command with a description for the help."""

    def __init__(self, names: Sequence[str], *, note: str, **given: Any) -> None:
        super().__init__(names, **given)
        self.note = f"{note}  [required]" if self.required else note

    def make_metavar(self, ctx: click.Context) -> str:  # noqa: ARG002 - click's
        """Return the argument's placeholder as the usage shows it."""
        shown = f"{self.metavar}..." if self.nargs == -1 else f"{self.metavar}"
        return shown if self.required else f"[{shown}]"


def option_of(parameter: inspect.Parameter) -> Option:
    """Return the command-line format of a parameter of a public function."""
    if parameter.kind is inspect.Parameter.KEYWORD_ONLY:
        declared = parameter.annotation
        parts = str(getattr(declared, "__name__", declared)).split(" | ")
        option = next((OPTIONS[part] for part in parts if part in OPTIONS), Option(str))
        return option._replace(metavar=_METAVARS.get(parameter.name, option.metavar))
    return ARGUMENTS.get(parameter.name, Option(str, parameter.name.upper(), parse_path))


def flag_of(name: str, option: Option) -> click.Parameter:
    """Return a click option for one of `FLAGS`."""
    default = False if option.kind is bool else None
    return declared(
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default), option
    )


def declared(parameter: inspect.Parameter, option: Option) -> click.Parameter:
    """Return a click option or argument for a parameter."""
    default = parameter.default
    required = default is inspect.Parameter.empty
    if isinstance(default, float):
        default = float(f"{default:.3g}")  # rounded for the help
    given: dict[str, Any] = {
        "type": option.kind,
        "metavar": option.metavar,
        "required": required,
        "callback": option.converted,
        # Without "default", click insists on a required value; None would count as a default.
        **({} if required else {"default": default}),
    }
    if parameter.kind is not inspect.Parameter.KEYWORD_ONLY:
        nargs = -1 if option.several else 1
        return Argument([parameter.name], note=option.note, nargs=nargs, **given)
    dashed, flag = parameter.name.replace("_", "-"), option.kind is bool
    return click.Option(
        [f"--{dashed}/--no-{dashed}" if default is True else f"--{dashed}"],
        help=option.note,
        show_default=not option.several and (not flag or default is True),
        is_flag=flag,
        multiple=option.several,
        **given,
    )
