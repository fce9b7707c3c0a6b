"""``flexid derive MODEL``: the observer's equations of a model."""

from enum import StrEnum
from typing import Annotated

import typer

from flexid.library.derive import SHIPPED, declared, derived_observer, observer_text

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
    observer = derived_observer(declared(model, terms, unknown_input_gain))
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
    typer.echo(observer_text(observer, to), nl=False)
