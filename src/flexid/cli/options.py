"""Arguments and options that several commands have in common, each declared once."""

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from flexid.cli.assignments import (
    parse_bounds,
    parse_known,
    parse_names,
    parse_number,
)
from flexid.errors import SettingError
from flexid.models.arm_name import is_arm_file
from flexid.readers.formats import kinds

if TYPE_CHECKING:
    from flexid.identification.preparation.settings import Settings


def directory(text: str) -> Path:
    """A directory to write into."""
    if not text.strip():
        raise SettingError("--out", "its name is empty: name a directory, e.g. results")
    return Path(text)


def out_option(what: str) -> Any:
    """The option ``--out`` of a command that writes some files."""
    return typer.Option(metavar="DIR", parser=directory, help=f"Write {what} into this directory.")


Logs = Annotated[
    list[Path],
    typer.Argument(
        metavar="LOG",
        help=f"Logs of one drive: {kinds()}.",
        show_default=False,
    ),
]

Columns = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Read the logs' columns as this TOML map says: renamed, scaled, combined.",
    ),
]

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]

Strict = Annotated[
    bool,
    typer.Option("--strict", help="Exit with status 1 where something is weak, too."),
]

Known = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help="Take a physical parameter or coefficient as known, exactly (motor_inertia=0.3) or "
        "with a standard deviation (joint_stiffness=100+-5). May be repeated.",
    ),
]
_Bounds = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=LOW:HIGH",
        help="Keep a physical parameter or coefficient within bounds (joint_stiffness=50:200, "
        "motor_viscous_friction=0:). May be repeated.",
    ),
]
Model = Annotated[
    str,
    typer.Option(
        metavar="MODEL",
        help="Model of the joint: flexible, link (the link alone, driven by the measured motor "
        "position, without the torque), rigid (the motor's encoder alone), or the TOML file of an "
        "arm of several joints.",
    ),
]
_Terms = Annotated[
    str,
    typer.Option(
        metavar="NAMES", help="Terms of the model beside the joint spring, between commas."
    ),
]
_Hold = Annotated[
    str,
    typer.Option(
        metavar="WORD",
        help="How the input behaves between samples: zero (held), linear or cubic (smooth).",
    ),
]
_InputDelay = Annotated[
    str, typer.Option(metavar="SECONDS", help="How much later than recorded the input acts.")
]
_LinkDelay = Annotated[
    str,
    typer.Option(metavar="SECONDS", help="How much later than the motor's the link encoder is."),
]
_CoulombVelocity = Annotated[
    str,
    typer.Option(
        metavar="RAD/S",
        help="Velocity over which Coulomb friction changes its sign; auto: at once.",
    ),
]
_FilterRate = Annotated[
    str, typer.Option(metavar="1/S", help="Rate of the filter of least squares.")
]
_SegmentDuration = Annotated[
    str,
    typer.Option(metavar="SECONDS", help="Length of the segments over which the model is fitted."),
]
_ValidationShare = Annotated[
    float,
    typer.Option(
        metavar="SHARE",
        show_default="a third",
        help="Share of each log, at its end, that is kept out of the fit and predicted.",
    ),
]


def _settings(
    known: Known = None,
    bounds: _Bounds = None,
    model: Model = "auto",
    terms: _Terms = "auto",
    hold: _Hold = "auto",
    input_delay: _InputDelay = "auto",
    link_delay: _LinkDelay = "auto",
    coulomb_velocity: _CoulombVelocity = "auto",
    filter_rate: _FilterRate = "auto",
    segment_duration: _SegmentDuration = "auto",
    validation_share: _ValidationShare = 1 / 3,
) -> "Settings":
    from flexid.identification.preparation.settings import Settings

    values, deviations = parse_known(known or [])
    return Settings(
        model=model,  # type: ignore[arg-type] - Settings checks it
        terms="auto" if terms == "auto" else parse_names(terms),
        known=values,
        known_deviations=deviations,
        bounds=parse_bounds(bounds or []),
        hold=hold,  # type: ignore[arg-type] - Settings checks it
        input_delay=parse_number("--input-delay", input_delay),
        link_delay=parse_number("--link-delay", link_delay),
        coulomb_velocity=parse_number("--coulomb-velocity", coulomb_velocity),
        filter_rate=parse_number("--filter-rate", filter_rate),
        segment_duration=parse_number("--segment-duration", segment_duration),
        validation_share=validation_share,
    )


def with_settings(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of an identification in place of its parameter ``settings``.

    A command with a parameter ``arm`` takes arms, too: that is the file after ``--model``.
    """
    shared = inspect.signature(_settings).parameters
    takes_arms = "arm" in inspect.signature(command).parameters
    own = {n: p for n, p in inspect.signature(command).parameters.items() if n != "arm"}

    @wraps(command)
    def with_options(**given: Any) -> None:
        options = {name: given.pop(name) for name in shared}
        if is_arm_file(options["model"]):
            arm = _arm_alone(options, {n: p.default for n, p in shared.items()}, takes_arms)
            command(**given, settings=_settings(), arm=arm)
        else:
            command(**given, settings=_settings(**options))

    parameters: list[inspect.Parameter] = []
    for name, parameter in own.items():
        parameters += shared.values() if name == "settings" else [parameter]
    hints = get_type_hints(_settings, localns=_LATE, include_extras=True) | get_type_hints(
        command, localns=_LATE, include_extras=True
    )
    # What Typer reads in place of the function's own.
    with_options.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [p.replace(annotation=hints[p.name], kind=p.KEYWORD_ONLY) for p in parameters]
    )
    with_options.__annotations__ = {p.name: hints[p.name] for p in parameters}
    return with_options


def _arm_alone(options: dict[str, Any], defaults: dict[str, Any], takes_arms: bool) -> Path:
    """The file of an arm."""
    if not takes_arms:
        raise SettingError("model", f"{options['model']!r} is an arm: only flexid identify does it")
    for name, value in options.items():
        if name != "model" and value != defaults[name]:
            option = name.replace("_", "-")
            raise SettingError(option, "is for one joint, and --model names an arm: leave it out")
    return Path(options["model"])


_LATE = {"Settings": object}  # not imported before it is needed
