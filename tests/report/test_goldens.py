"""Printed answers and pages, line by line, compared with ``texts/``."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest
from made_result import VALIDATION, made_result
from shown import WIDTH, answer_lines, check, page_lines

from flexid.arrays import to_json
from flexid.estimators.excitation import excitation_of_gram
from flexid.experiments.campaign_store import Manifest, Result, Summary
from flexid.identification.vocabulary.evidence import FreeRun, ModelError
from flexid.library import validation as library
from flexid.report import campaign, validation, watch
from flexid.report.comparison import comparison_summary, largest, outcome_text
from flexid.report.comparison import parts as comparison_parts
from flexid.report.identification import answers, estimates_table, evidence, parts, verdict_reasons
from flexid.report.terminal import Part, as_text
from flexid.stored_estimates.comparison import compare_estimates
from flexid.stored_estimates.estimate_file import estimate_document
from flexid.stored_estimates.validate_estimate import EstimateValidation
from flexid.streaming.guard import Counts
from flexid.streaming.options import WatchOptions
from flexid.streaming.session import Session
from made_estimates import STIFFER, TRUE, exact, with_parameter


def printed(*items: Part) -> list[str]:
    """Return the lines printed on a terminal."""
    return as_text(items, WIDTH).splitlines()


def identification():
    """Return an answer in which each number occurs once, with the evidence for its choices."""
    result = made_result()
    return printed(*parts(result), *evidence(result))


def exact_fit():
    """Return an answer without disturbances and with a model error."""
    result = made_result(ModelError(16.0, 1.2, 0.72))
    held = replace(result.validation, fit_percent={"motor_position": 99.0})
    result = replace(result, disturbances=None, validation=held)
    return printed(*parts(result), *evidence(result))


def document():
    """Return the stored estimate without singular vectors, whose digits may differ."""
    made = estimate_document(made_result())
    del made["excitation"]
    return to_json(made).splitlines()


def negligible():
    """Return an answer with a negligible value, and a motor at rest."""
    result = made_result()
    small = replace(result.parameters["gravity_torque"], interval=(-1e-4, 1e-4))
    still = {"motor_position": nan}
    result = replace(
        result, parameters={"x": small}, validation=replace(result.validation, fit_percent=still)
    )
    return printed(*parts(result))


def streamed():
    """Return the explanation of a least-squares result, in which two values share a reason."""
    made = made_result()
    choices = replace(made.choices, estimator="least-squares", term_evidence=())
    known = made.coefficients["theta1"]
    reasons = {"theta1": "is wide", "alpha1": "contradicts", "alpha2": "contradicts"}
    doubtful = {n: replace(known, verdict="weak", reason=said) for n, said in reasons.items()}
    return printed(*verdict_reasons(doubtful), *evidence(replace(made, choices=choices)))


def narrow():
    """Return tables with long names, broken after underscores; intervals and units stay whole."""
    (known,) = made_result().parameters.values()
    table = {
        name: replace(known, name=name, value=399.98, interval=(396.91, 403.13), unit="N m s/rad")
        for name in ("viscous_friction_per_motor_inertia", "link_inertia")
    }
    return [
        *as_text([estimates_table("At 76", table)], 76).splitlines(),
        *as_text([estimates_table("At 40", table)], 40).splitlines(),
    ]


def verdicts(*of_parameters: str, coefficient: str = "determined", **more):
    """Return a result whose parameters, and whose last coefficient, have these verdicts."""
    made = made_result(ModelError(0.05, 0.9, 0.0))
    (known,) = made.parameters.values()
    parameters = {
        f"p{i}": replace(known, name=f"p{i}", verdict=verdict, reason="is wide")
        for i, verdict in enumerate(of_parameters)
    }
    last = replace(made.coefficients["alpha_coulomb"], verdict=coefficient)
    coefficients = {**made.coefficients, last.name: last}
    others = {"warnings": (), "disturbances": None, **more}
    return replace(made, parameters=parameters, coefficients=coefficients, **others)


def trust_and_next_step():
    """Yield each verdict with its first answer and the next step."""
    confounded = excitation_of_gram("link", ["a", "b"], np.array([[1.0, 0.9999], [0.9999, 1.0]]))
    clear = excitation_of_gram("motor", ["c", "d"], np.array([[1.0, 0.3], [0.3, 1.0]]))
    diverging = replace(VALIDATION, fit_percent={"deflection": -865.0})
    for result in (
        verdicts("determined"),
        verdicts("determined", warnings=("w",)),
        verdicts("determined", coefficient="weak"),
        verdicts("determined", "weak"),
        verdicts("determined", "weak", "undetermined"),
        verdicts("undetermined"),
        verdicts("determined", validation=diverging),
        verdicts("weak", model_error=ModelError(2.0, 0.9, 0.5)),
        verdicts("weak", disturbances=made_result().disturbances),
        verdicts("weak", excitation={"motor": clear, "link": confounded}),
        verdicts("weak", excitation={"motor": clear}),
    ):
        yield from answer_lines(answers(result))


def stiffer():
    """Return the comparison of a drive with a stiffer one with an offset, which A lacks."""
    a, b = exact(TRUE, "one"), exact({**STIFFER, "alpha_offset": 3.0}, "two")
    offset = replace(b.parameters["motor_offset_torque"], value=0.001, interval=(-0.1, 0.1))
    a = replace(a, removed={offset.name: offset})
    return compare_estimates(a, b, ("before.json", "after.json"))


def comparison():
    """Return each value of two drives."""
    return printed(*comparison_parts(stiffer()))


def bounds():
    """Yield bounds: rounded up, at most as large as the value, in per cent or in a unit."""
    found = stiffer()
    share = replace(found.parameters["joint_stiffness"], outcome="no change")
    for ends in ((-700.0, 101.0), (-99.0, 5.0), (-1.0, 2.11), (-1.0, 2.2), (-1.0, 1.01)):
        one = replace(share, percent_interval=ends)
        yield outcome_text(one).plain
        yield from comparison_summary(replace(found, parameters={one.name: one}))
    offset = replace(found.parameters["motor_offset_torque"], percent_interval=(nan, nan))
    yield from (largest(replace(offset, interval=(-0.1, end))) for end in (0.0512, 0.1512, inf))


def compared():
    """Yield summaries: changed, same, doubtful, missing, contradictory, and the same log."""
    a, same, stiffer = exact(TRUE, "a"), exact(TRUE, "b"), exact(STIFFER, "b")
    p = same.parameters["gravity_torque"]
    doubtful = with_parameter(same, p.name, value=p.value + 2.2 * 2**0.5 * p.std)
    unknown = with_parameter(same, p.name, verdict="undetermined", reason="contradicted")
    again = replace(exact(TRUE, "a"), provenance={**a.provenance, "settings": {"hold": "zero"}})
    for b in (same, stiffer, doubtful, unknown, exact(STIFFER, "a"), again):
        yield from comparison_summary(compare_estimates(a, b))


def campaigns():
    """Yield the summary of a campaign of 100 runs, unfinished and finished."""
    about = {"flexid": "1.0", "experiment": "0123", "plan": "4567", "text": "the file"}
    manifest = Manifest(**about, kind="sobol", runs=100, inputs=("controller.k",), runs_per_part=10)
    names = "tracking_rms", "settling_time.theta1"
    shares = {"0.05": 1.0, "0.5": 1.5, "0.95": 2.0}
    results = {name: Result(2, 1, shares) for name in names}
    begun, done = {"finished": 30, "error": 10}, {"finished": 97, "diverged": 3}
    first_error = "file: no such value"
    for summary in (
        Summary(Path("out"), manifest, 40, ("part-3",), begun, first_error, {}),
        Summary(Path("out"), manifest, 100, (), done, "", results),
    ):
        yield from printed(*campaign.parts(summary))


TIME = np.linspace(0.0, 1.0, 101)
SEEN = np.sin(7.0 * TIME)[:, None]
VALIDATED = EstimateValidation(
    fit_percent={"motor_position": 97.53},
    runs=(FreeRun(TIME, SEEN, SEEN + 1e-3 * np.cos(50.0 * TIME)[:, None]),),
    horizons={0.05: {"motor_position": 99.1}},
    model="rigid",
    types=("revolute",),
    residuals={0.05: {"motor_position": 5e-4}, inf: {"motor_position": 1e-3}},
    noise={"motor_position": 4e-4},
    provenance={"flexid_version": "0", "inputs": [{"file": "runs/my log.csv", "sha256": "ab"}]},
)


def validations():
    """Yield validations with good and poor fits, and one whole page."""
    for fit in (49.0, -20.0, -inf, nan):
        yield from printed(
            *validation.parts(replace(VALIDATED, fit_percent={"motor_position": fit}))
        )
    for fit in (40.0, 60.0):
        over = {**VALIDATED.horizons, 5.0: {"motor_position": fit}}
        drifting = replace(VALIDATED, fit_percent={"motor_position": -700.0}, horizons=over)
        yield [*validation.parts(drifting)][-2]
    answer = library.EstimateValidation(replace(VALIDATED, warnings=("beware",)))
    yield from page_lines(answer._page("flexid validate e.json"))


def watched():
    """Yield the report on a drive at rest."""
    session = Session(WatchOptions(2e-3, ("gravity", "motor_viscous"), hold="linear"))
    samples = np.zeros((1500, 4))
    samples[:, 0] = 2e-3 * np.arange(1500)
    session.feed(samples)
    yield from printed(*watch.parts(session))


def counts():
    """Yield sentences with the counts of a stream's samples, without zero counts."""
    nothing = Counts(*[0] * 12)
    yield nothing.sentence
    yield Counts(90, 1, 2, 0, 3, 0, 4, 1, 5, 2, 0, 0).sentence


ANSWERS = (
    identification, exact_fit, document, negligible, streamed, narrow, trust_and_next_step,
    comparison, bounds, compared, campaigns, validations, watched, counts,
)  # fmt: skip


@pytest.mark.parametrize("answer", ANSWERS)
def test_it_is_shown_as_it_was(answer: Callable[[], Iterable[str]], request: pytest.FixtureRequest):
    """Assert that every line equals the stored one, and that nothing is cut off."""
    lines = [*answer()]
    assert "…" not in "".join(lines)
    check(answer.__name__, lines, request)
