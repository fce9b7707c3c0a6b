"""``flexid derive MODEL``: the observer's equations of a model."""

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from flexid.errors import SettingError

if TYPE_CHECKING:
    from flexid.models.parametric_system import ParametricSystem

SHIPPED = "flexible-joint"
"""Name of the model that needs no file."""


EXAMPLES = (
    "derive flexible-joint --to latex",
    "derive examples/models/pendulum.toml --to c",
)


class Target(StrEnum):
    """What the equations are printed as."""

    LATEX = "latex"
    PYTHON = "python"
    C = "c"


def derive(
    model: Annotated[
        str,
        typer.Argument(metavar="MODEL", help=f"TOML model file, or {SHIPPED}.", show_default=False),
    ],
    to: Annotated[Target, typer.Option(help="Print LaTeX, Python or C.")] = Target.LATEX,
    terms: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help=f"Terms of {SHIPPED}, between commas; the paper's if not given.",
        ),
    ] = None,
    unknown_input_gain: Annotated[
        bool, typer.Option("--unknown-input-gain", help=f"Estimate beta1 of {SHIPPED} as well.")
    ] = False,
) -> None:
    """Derive a model's observer as LaTeX, Python or C.

    The observer estimates the model's coefficients while the machine runs (Huang, 2003).

    Exit status: 0 when it is done, 2 for bad input, which includes a model that has no observer.
    """
    from flexid.derivation.observer import derive_observer
    from flexid.derivation.printing_c import c_observer
    from flexid.derivation.printing_latex import latex_observer
    from flexid.derivation.printing_python import python_observer

    observer = derive_observer(_declared(model, terms, unknown_input_gain))
    if observer.quadratures:
        typer.echo(
            f"note: no sound closed form for the immersion of {', '.join(observer.quadratures)}; "
            "integrated numerically",
            err=True,
        )
    if observer.input_rates:
        rates = ", ".join(map(str, observer.input_rates))
        typer.echo(
            f"note: the observer needs the input's rate of change: {rates}; "
            "least squares (flexid identify) does not",
            err=True,
        )
    printers = {
        Target.LATEX: latex_observer,
        Target.PYTHON: python_observer,
        Target.C: c_observer,
    }
    typer.echo(printers[to](observer), nl=False)


def _declared(model: str, terms: str | None, unknown_input_gain: bool) -> "ParametricSystem":
    if model != SHIPPED:
        if terms is not None or unknown_input_gain:
            raise SettingError(
                "--unknown-input-gain" if terms is None else "--terms",
                f"belongs to {SHIPPED}; a model file states its own terms",
            )
        from flexid.models.model_file import read_model

        return read_model(model)
    from flexid.models.flexible_joint import PAPER_TERMS, flexible_joint

    chosen = PAPER_TERMS if terms is None else [t.strip() for t in terms.split(",") if t.strip()]
    # The equations hold for every value of a known beta1, which stays a symbol in them.
    return flexible_joint(chosen, known=None if unknown_input_gain else {"beta1": 1.0})
