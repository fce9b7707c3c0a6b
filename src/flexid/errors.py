"""Exceptions that flexid raises on purpose: fields for programs, one sentence for users."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, fields
from difflib import get_close_matches
from typing import Any, ClassVar


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return the end of a message about an unknown word: the closest known one, or all of them."""
    names = [*known]
    close = get_close_matches(word, names, n=1, cutoff=0.6)
    return f": did you mean {close[0]}?" if close else f": there are {', '.join(names)}"


@dataclass(eq=False, repr=False)
class FlexidError(Exception):
    """Base class of all exceptions that flexid raises on purpose; instances can be pickled."""

    _text: ClassVar[str] = ""  # template of the message, with the fields of the class

    def __str__(self) -> str:
        return self._text.format_map(vars(self))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, field.name) for field in fields(self))


@dataclass(eq=False, repr=False)
class ExpressionError(FlexidError):
    """A text expression uses a name or an operation that is not allowed."""

    expression: str  # the offending text
    reason: str  # what is wrong with it and what to write instead
    place: str = "expression"  # where the text is: a file, a row, a coefficient

    def __str__(self) -> str:
        text = self.expression
        shown = text if len(text) <= 60 else text[:57] + "..."
        return f"{self.place}: {shown!r}: {self.reason}"


@dataclass(eq=False, repr=False)
class ModelError(FlexidError):
    """A model, controller or reference is declared inconsistently."""

    model: str  # name or file of the declaration
    reason: str  # what is wrong and what to do about it
    _text = "{model}: {reason}"


@dataclass(eq=False, repr=False)
class AccelerationError(FlexidError):
    """The parametric observer of a model would require an acceleration."""

    model: str  # place of the offending regressor: model, row, coefficient
    row: str
    coefficient: str
    velocity: str  # velocity of another row, on which the regressor depends
    _text = (
        "{model}: row {row!r}: the regressor of {coefficient!r} depends on {velocity!r}, the "
        "velocity of another row, so its cancelling term needs the acceleration d{velocity}/dt: "
        "drop the term, or estimate this row by least squares on filtered regressors, which needs "
        "no cancelling term"
    )


@dataclass(eq=False, repr=False)
class RecordingError(FlexidError):
    """A log or recording cannot be used."""

    file: str  # the file or source of the recording
    place: str  # row, column or key
    reason: str  # what is wrong there and the remedy

    def __str__(self) -> str:
        place = f"{self.place}: " if self.place else ""
        return f"{self.file}: {place}{self.reason}"


@dataclass(eq=False, repr=False)
class SimulationError(FlexidError):
    """A simulation could not meet its tolerance."""

    reason: str  # what failed and what to change
    time: float  # simulated time at which it failed, in s
    _text = "simulation stopped at t = {time:.6g} s: {reason}"


@dataclass(eq=False, repr=False)
class SettingError(FlexidError):
    """An option or setting has a value that cannot be used."""

    setting: str  # name of the option or setting
    reason: str  # what is wrong with the value and what is accepted
    _text = "{setting}: {reason}"


@dataclass(eq=False, repr=False)
class ExperimentError(FlexidError):
    """An experiment file, or a value set in it, cannot be used."""

    path: str  # the file
    key: str  # dotted path of the key; empty for the whole file
    reason: str  # what is wrong, a predicate of the key or the file, and the remedy

    def __str__(self) -> str:
        what = f"the key {self.key!r} {self.reason}" if self.key else self.reason
        return f"{self.path}: {what}"


@dataclass(eq=False, repr=False)
class CampaignError(FlexidError):
    """A campaign cannot be run, resumed or summarised."""

    place: str  # the directory, file or scheduler
    reason: str  # what is wrong there, a predicate of the place, and the remedy
    _text = "{place} {reason}"


@dataclass(eq=False, repr=False)
class ConvergenceError(FlexidError):
    """An iterative estimate did not converge, or converged to values that the data contradict."""

    estimator: str  # which estimator
    reason: str  # what happened and what to change
    _text = "{estimator}: {reason}"


@dataclass(eq=False, repr=False)
class ArgumentError(FlexidError, TypeError):
    """A function was called with an unknown argument, or with one of a wrong type."""

    function: str
    argument: str
    reason: str  # what is wrong with it, a predicate, and what is accepted
    _text = "{function}: {argument} {reason}"


def check_names(setting: str, names: Iterable[str], known: Collection[str]) -> None:
    """Raise a `SettingError` for the first name that is not in `known`."""
    for name in names:
        if name not in known:
            raise SettingError(setting, f"{name!r} is unknown{did_you_mean(str(name), known)}")


def one_of(setting: str, text: str, known: Iterable[str]) -> str:
    """Return a text that is in `known`; raise a `SettingError` with all choices for any other."""
    names = [*known]
    if text not in names:
        raise SettingError(setting, f"{text[:40]!r} is not one of {', '.join(names)}")
    return text
