"""The observer's equations of a model: `flexid.derive`."""

from collections.abc import Iterable, Iterator
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal

from flexid.errors import SettingError, did_you_mean
from flexid.library.entrance import as_path, entrance
from flexid.library.options import as_names
from flexid.models.parametric_system import ParametricSystem

if TYPE_CHECKING:
    from flexid.derivation.observer import SymbolicObserver

SHIPPED = "flexible-joint"
"""Name of the model that needs no file."""


class ObserverText(str):
    """Equations as text, with what to know of them."""

    notes: tuple[str, ...]

    def __new__(cls, text: str, notes: tuple[str, ...] = ()) -> "ObserverText":
        """The text with its notes."""
        made = super().__new__(cls, text)
        made.notes = notes
        return made


@entrance
def derive(
    model: "ParametricSystem | str | PathLike[str]",
    *,
    to: Literal["latex", "python", "c"] = "latex",
    terms: Iterable[str] | None = None,
    unknown_input_gain: bool = False,
) -> ObserverText:
    """Derive a model's observer as LaTeX, Python or C.

    The observer estimates the model's coefficients while the machine runs (Huang, 2003).

    Parameters
    ----------
    model : ParametricSystem or path
        A TOML model file, or flexible-joint. Or a `ParametricSystem`.
    to : {"latex", "python", "c"}, optional
        What the equations are printed as.
    terms : iterable of str, optional
        Terms of flexible-joint; those of the paper if not given.
    unknown_input_gain : bool, optional
        Estimate beta1 of flexible-joint as well.

    Returns
    -------
    str
        The equations as LaTeX, a Python module, or a C99 file. Its `notes` are sentences on what is
        integrated numerically, and on rates of inputs that the observer needs.

    Raises
    ------
    ModelError
        If the model file cannot be used.
    AccelerationError
        If the observer would need an acceleration.
    SettingError
        If an option does not suit the model.
    ArgumentError
        If an option is unknown or of a wrong type.
    """
    from flexid.derivation.observer import derive_observer
    from flexid.derivation.printing_c import c_observer
    from flexid.derivation.printing_latex import latex_observer
    from flexid.derivation.printing_python import python_observer

    printers = {"latex": latex_observer, "python": python_observer, "c": c_observer}
    if to not in printers:
        raise SettingError("to", f"{to!r} is unknown{did_you_mean(str(to), printers)}")
    observer = derive_observer(declared(model, terms, unknown_input_gain))
    return ObserverText(printers[to](observer), tuple(_notes(observer)))


def _notes(observer: "SymbolicObserver") -> Iterator[str]:
    if observer.quadratures:
        yield (
            f"no sound closed form for the immersion of {', '.join(observer.quadratures)}; "
            f"integrated numerically"
        )
    if observer.input_rates:
        rates = ", ".join(map(str, observer.input_rates))
        yield (
            f"the observer needs the input's rate of change: {rates}; least squares (flexid "
            f"identify) does not"
        )


def declared(model: Any, terms: Iterable[str] | None, unknown_input_gain: bool) -> ParametricSystem:
    """The model that is meant."""
    if isinstance(model, str) and model == SHIPPED:
        from flexid.models.flexible_joint import PAPER_TERMS, flexible_joint

        # The equations hold for every value of a known beta1, which stays a symbol in them.
        known = None if unknown_input_gain else {"beta1": 1.0}
        return flexible_joint(
            PAPER_TERMS if terms is None else as_names("derive", terms), known=known
        )
    if terms is not None or unknown_input_gain:
        raise SettingError(
            "unknown-input-gain" if terms is None else "terms",
            f"belongs to {SHIPPED}; a model states its own terms",
        )
    if isinstance(model, ParametricSystem):
        return model
    from flexid.models.model_file import read_model

    return read_model(as_path("derive", "model", model))
