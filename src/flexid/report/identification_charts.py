"""The charts of an identification: the fit, the estimates over time, excitation, joint regions."""

import numpy as np

from flexid.analysis.excitation import LOST_CONDITION, WEAK_CONDITION, Excitation
from flexid.frequency.frequency_response import frequency_response
from flexid.identification.result.identification import Identification
from flexid.report.bode_chart import bode_chart
from flexid.report.charts.description import Axis, Chart, Level, Panel, Points
from flexid.report.estimates_chart import estimates_chart
from flexid.report.free_run_chart import free_run_chart, residual_chart
from flexid.report.regions_chart import regions_chart

_FLOOR = 1e-7  # below which a relative singular value is drawn as this
_HEIGHT = 1.4


def identification_charts(result: Identification) -> tuple[Chart, ...]:
    """All that the result has the data for: a loaded one has no time series."""
    charts = []
    if result.validation.runs:
        charts += [fit_chart(result), residual_chart(result.validation)]
    if len(result.observer.time):
        charts.append(estimates_chart(result))
    charts += [
        excitation_chart(result),
        bode_chart(frequency_response(result, result.recordings)),
        regions_chart(result),
    ]
    return tuple(chart for chart in charts if chart is not None)


def fit_chart(result: Identification) -> Chart:
    """Free run of the model over the held-out data, channel by channel, and its residual."""
    deviation = result.compliance.deflection_noise
    flexible = result.model == "flexible"  # a link's deflection has no noise of the motor's encoder
    noise = {"deflection": deviation} if flexible and 0.0 < deviation < np.inf else {}
    title = "Free run of the model over data kept out of the fit"
    return free_run_chart("fit", title, result.validation, noise, "time")


def excitation_chart(result: Identification) -> Chart:
    """Singular values of each row's normalised Gram matrix, and its condition number."""
    rows = [*result.excitation.values()]
    worst = max(rows, key=lambda row: row.condition_number)
    says = (
        "Each point is a combination of a row's coefficients; its height is how well the motion "
        "excites it, relative to the best. Near the red line it is not determined. "
        f"The weakest is in the {worst.row} row, at {1.0 / worst.condition_number:.2g}"
        f"{_pair(worst)}."
    )
    title = "Excitation: singular values of each row"
    return Chart("excitation", title, says, tuple(map(_panel, rows)), len(rows), linked=False)


def _panel(excitation: Excitation) -> Panel:
    relative = excitation.singular_values / excitation.singular_values[0]
    places = np.arange(1.0, len(relative) + 1.0)
    title = f"{excitation.row} row: condition number {excitation.condition_number:.3g}"
    if excitation.correlated:
        pair = " and ".join(excitation.correlated)
        title += f"\n{pair} correlate by {excitation.correlation:.2f}"
    return Panel(
        title,
        Axis("direction, best excited first", limits=(0.5, len(relative) + 0.5), step=1.0),
        Axis("singular value over the largest", "–", logarithmic=True, limits=(_FLOOR, 3.0)),
        (
            Points("", places, np.maximum(relative, _FLOOR), "blue", 6.0, stems=True),
            Level("weak below", 1.0 / WEAK_CONDITION, "y", "orange", "dashed"),
            Level("lost below", 1.0 / LOST_CONDITION, "y", "red", "dashed"),
        ),
        _HEIGHT,
    )


def _pair(excitation: Excitation) -> str:
    """The confounded pair in words, where a row has one."""
    if not excitation.correlated:
        return ""
    first, second = excitation.correlated
    return f", where {first} and {second} correlate by {excitation.correlation:.2f}"
