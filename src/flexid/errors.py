"""Every exception flexid raises on purpose.

One root, `FlexidError`; each subclass carries its data as fields, and its text is one sentence
that names the place and the remedy, fit to be shown to a user as it stands.
"""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """What to write instead of a word, after what is said of it: the nearest, or all there are."""
    names = [*known]
    close = get_close_matches(word, names, n=1, cutoff=0.6)
    return f": did you mean {close[0]}?" if close else f": there are {', '.join(names)}"


class FlexidError(Exception):
    """Root of all exceptions that flexid raises on purpose; they travel between processes."""

    def __reduce__(self) -> tuple[Any, ...]:
        # An exception is otherwise made again from its text alone, where these want their fields.
        return _again, (type(self), self.args, self.__dict__)


def _again(kind: type[FlexidError], texts: tuple[str, ...], fields: dict[str, Any]) -> FlexidError:
    error = kind.__new__(kind, *texts)
    error.__dict__.update(fields)
    return error


class ExpressionError(FlexidError):
    """A text expression uses something outside the whitelist.

    Parameters
    ----------
    expression : str
        The offending text.
    reason : str
        What is wrong with it and what may stand there instead.
    place : str
        Where the text stands: a file, a row, a coefficient.
    """

    def __init__(self, expression: str, reason: str, place: str = "expression") -> None:
        self.expression = expression
        self.reason = reason
        self.place = place
        shown = expression if len(expression) <= 60 else expression[:57] + "..."
        super().__init__(f"{place}: {shown!r}: {reason}")


class ModelError(FlexidError):
    """A model, controller or reference is declared inconsistently.

    Parameters
    ----------
    model : str
        Name or file of the declaration.
    reason : str
        What is wrong and what to do about it.
    """

    def __init__(self, model: str, reason: str) -> None:
        self.model = model
        self.reason = reason
        super().__init__(f"{model}: {reason}")


class AccelerationError(FlexidError):
    """The parametric observer of a model would need an acceleration.

    Parameters
    ----------
    model, row, coefficient : str
        Where the offending regressor stands.
    velocity : str
        The velocity of another row on which the regressor depends.
    """

    def __init__(self, model: str, row: str, coefficient: str, velocity: str) -> None:
        self.model = model
        self.row = row
        self.coefficient = coefficient
        self.velocity = velocity
        super().__init__(
            f"{model}: row {row!r}: the regressor of {coefficient!r} depends on {velocity!r}, the "
            f"velocity of another row, so its cancelling term needs the acceleration "
            f"d{velocity}/dt: drop the term, or estimate this row by least squares on filtered "
            f"regressors, which needs no cancelling term"
        )


class RecordingError(FlexidError):
    """A recording cannot be used as it stands.

    Parameters
    ----------
    file : str
        The file or source of the recording.
    place : str
        Row, column or key.
    reason : str
        What is wrong there and the remedy.
    """

    def __init__(self, file: str, place: str, reason: str) -> None:
        self.file = file
        self.place = place
        self.reason = reason
        super().__init__(f"{file}: {place}: {reason}" if place else f"{file}: {reason}")


class SimulationError(FlexidError):
    """A simulation could not meet its tolerance.

    Parameters
    ----------
    reason : str
        What failed and what to change.
    time : float
        Simulated time at which it failed, in seconds.
    """

    def __init__(self, reason: str, time: float) -> None:
        self.reason = reason
        self.time = time
        super().__init__(f"simulation stopped at t = {time:.6g} s: {reason}")


class SettingError(FlexidError):
    """An option or setting has a value that cannot be used.

    Parameters
    ----------
    setting : str
        Name of the option or setting.
    reason : str
        What is wrong with the value and what is accepted.
    """

    def __init__(self, setting: str, reason: str) -> None:
        self.setting = setting
        self.reason = reason
        super().__init__(f"{setting}: {reason}")


class ExperimentError(FlexidError):
    """An experiment file, or a value set in it, cannot be used.

    Parameters
    ----------
    path : str
        The file.
    key : str
        Dotted path of the key; empty where the whole file is meant.
    reason : str
        What is wrong, a predicate of the key or the file, and the remedy.
    """

    def __init__(self, path: str, key: str, reason: str) -> None:
        self.path = path
        self.key = key
        self.reason = reason
        super().__init__(f"{path}: the key {key!r} {reason}" if key else f"{path}: {reason}")


class CampaignError(FlexidError):
    """A campaign cannot be run, resumed or summarised.

    Parameters
    ----------
    place : str
        The directory, file or scheduler.
    reason : str
        What is wrong there, a predicate of the place, and the remedy.
    """

    def __init__(self, place: str, reason: str) -> None:
        self.place = place
        self.reason = reason
        super().__init__(f"{place} {reason}")


class ConvergenceError(FlexidError):
    """An iterative estimate did not converge, or converged where the data contradict it.

    Parameters
    ----------
    estimator : str
        Which estimator.
    reason : str
        What happened and what to change.
    """

    def __init__(self, estimator: str, reason: str) -> None:
        self.estimator = estimator
        self.reason = reason
        super().__init__(f"{estimator}: {reason}")


class ArgumentError(FlexidError, TypeError):
    """A function was called with an argument that it does not take, or with one of a wrong type.

    Parameters
    ----------
    function : str
        Which function.
    argument : str
        Which argument.
    reason : str
        What is wrong with it, a predicate, and what would be right.
    """

    def __init__(self, function: str, argument: str, reason: str) -> None:
        self.function = function
        self.argument = argument
        self.reason = reason
        super().__init__(f"{function}: {argument} {reason}")
