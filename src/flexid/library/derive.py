"""The observer's equations of a model: `flexid.derive`."""

from collections.abc import Iterable
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal

from flexid.errors import ArgumentError, SettingError
from flexid.library.checks import as_path, kind_of
from flexid.library.entrance import did_you_mean, entrance
from flexid.models.parametric_system import ParametricSystem

if TYPE_CHECKING:
    from flexid.derivation.observer import SymbolicObserver

SHIPPED = "flexible-joint"
"""Name of the model that needs no file."""

TARGETS = ("latex", "python", "c")
"""What the equations are printed as."""


@entrance
def derive(
    model: "ParametricSystem | str | PathLike[str]",
    *,
    to: Literal["latex", "python", "c"] = "latex",
    terms: Iterable[str] | None = None,
    unknown_input_gain: bool = False,
) -> str:
    """Derive the parametric observer of a model and print its equations.

    Parameters
    ----------
    model : ParametricSystem or path
        A model, a TOML model file, or ``"flexible-joint"``.
    to : {"latex", "python", "c"}, optional
        What to print.
    terms : iterable of str, optional
        Terms of ``"flexible-joint"``; the paper's if not given.
    unknown_input_gain : bool, optional
        Estimate ``beta1`` of ``"flexible-joint"`` as well.

    Returns
    -------
    str
        The equations as LaTeX, a Python module, or a C99 file.

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
    if to not in TARGETS:
        raise SettingError("to", f"{to!r} is none{did_you_mean(str(to), TARGETS)}")
    return observer_text(derived_observer(declared(model, terms, unknown_input_gain)), to)


def derived_observer(system: ParametricSystem) -> "SymbolicObserver":
    """The parametric observer of a model."""
    from flexid.derivation.observer import derive_observer

    return derive_observer(system)


def observer_text(observer: "SymbolicObserver", to: str) -> str:
    """The equations of an observer as one of `TARGETS`."""
    from flexid.derivation.printing_c import c_observer
    from flexid.derivation.printing_latex import latex_observer
    from flexid.derivation.printing_python import python_observer

    return {"latex": latex_observer, "python": python_observer, "c": c_observer}[to](observer)


def declared(model: Any, terms: Iterable[str] | None, unknown_input_gain: bool) -> ParametricSystem:
    """The model that is meant."""
    if isinstance(model, str) and model == SHIPPED:
        from flexid.models.flexible_joint import PAPER_TERMS, flexible_joint

        # The equations hold for every value of a known beta1, which stays a symbol in them.
        known = None if unknown_input_gain else {"beta1": 1.0}
        return flexible_joint(PAPER_TERMS if terms is None else _names(terms), known=known)
    if terms is not None or unknown_input_gain:
        raise SettingError(
            "unknown-input-gain" if terms is None else "terms",
            f"belongs to {SHIPPED}; a model states its own terms",
        )
    if isinstance(model, ParametricSystem):
        return model
    from flexid.models.model_file import read_model

    return read_model(as_path("derive", "model", model))


def _names(terms: Any) -> tuple[str, ...]:
    if isinstance(terms, str):
        return tuple(name.strip() for name in terms.split(",") if name.strip())
    if not isinstance(terms, Iterable):
        raise ArgumentError("derive", "terms", f"is {kind_of(terms)}: give names")
    return tuple(terms)
