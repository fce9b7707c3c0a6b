"""The closed loop of Huang (2003), Table I."""

from flexid.models.flexible_joint import flexible_joint
from flexid.paper.laws import Controller, robust_law
from flexid.paper.loop import sinusoid
from flexid.simulation.closed_loop import ClosedLoop


def table_1(
    exponents: tuple[int, int, int] = (1, 2, 3), controller: Controller | None = None
) -> ClosedLoop:
    """Return the loop with a reading of the robust law, or with another controller."""
    return ClosedLoop(
        flexible_joint(known={"beta1": 1 / 0.3}),
        {"theta1": 5.0, "theta2": 100.0, "alpha1": 100 / 0.3, "alpha2": 0.1 / 0.3},
        controller or robust_law(exponents=exponents),
        sinusoid(3.0, 5.0),
        {"link": 1.0, "motor": 1.0},
        {"theta1": 2.5, "theta2": 50.0, "alpha1": 166.7, "alpha2": 0.167},
    )
