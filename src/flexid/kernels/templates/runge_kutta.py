"""Classical Runge-Kutta step.

Another template defines ``rates_at(x, place, motion, rate)``, which fills `rate` with the rates of
the state x at a place within the sampling interval, from 0 at its start to 1 at its end. `motion`
contains all other data of the model. That template also defines ``recall(x, start, motion)``, which
may set states of x that follow from the path since the start of the step.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *
    from flexid.kernels.templates.generated import *


@inlined
def node(stage):
    """Place of a stage within a step, from 0 to 1."""
    return 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)


@inlined
def runge_kutta(x, place, span, h, motion, work):
    """Integrate from x over a span, a fraction of an interval of h seconds.

    `work` has arrays for the end, the latest rates, and the states of the four stages.
    """
    end, rate, stages = work
    step, n = span * h, x.shape[0]
    for i in range(n):
        end[i] = x[i]
        stages[i] = x[i]
    for stage in range(4):
        weight = step / 6.0 if stage == 0 or stage == 3 else step / 3.0
        at_stage = stages[stage * n : (stage + 1) * n]
        rates_at(at_stage, place + node(stage) * span, motion, rate)
        for i in range(n):
            end[i] += weight * rate[i]
        if stage < 3:
            reach = node(stage + 1) * step
            then = stages[(stage + 1) * n : (stage + 2) * n]
            for i in range(n):
                then[i] = x[i] + reach * rate[i]
            recall(then, x, motion)
    recall(end, x, motion)
