"""The page of an identification: what its first screen answers, and that nothing in it is lost."""

from __future__ import annotations

import shlex
from dataclasses import asdict, replace

import numpy as np
import pytest
from made_result import VALIDATION, made_result

import flexid
from flexid.analysis.excitation import excitation_of_gram
from flexid.identification.preparation.settings import Settings
from flexid.identification.vocabulary.evidence import ModelError
from flexid.report.identification_charts import identification_charts
from flexid.report.identification_page import (
    identification_command,
    identification_page,
    next_step,
    trust,
)
from flexid.report.page import Bullets, Command, Facts

HOSTILE = "<script>alert(1)<"
FILE = '"><img src=x onerror=alert(2)>.csv'
COLUMNS = {
    name: {"column": f"{HOSTILE}{name}", "unit": unit}
    for name, unit in (
        ("time", "s"),
        ("link_position", "rad"),
        ("motor_position", "rad"),
        ("motor_torque", "N m"),
    )
}


@pytest.fixture(scope="module")
def estimate(examples, tmp_path_factory):
    """Return what is found in the example log, whose file and columns have hostile names."""
    text = (examples / "flexible_joint.csv").read_text()
    header = ",".join(column["column"] for column in COLUMNS.values())
    log = tmp_path_factory.mktemp("log") / FILE
    log.write_text(header + text[text.index("\n") :])
    return flexid.identify(
        log,
        columns=COLUMNS,
        terms=["gravity", "motor_viscous"],
        hold="zero",
        segment_duration=2.0,
    )


@pytest.fixture(scope="module")
def path(estimate, tmp_path_factory):
    """Return its page, alone in a folder."""
    path = tmp_path_factory.mktemp("alone") / "report.html"
    estimate.report(path)
    return path


def test_one_file_that_can_be_sent(path):
    """Assert that the page of 30 s at 1 kHz is below 1 MB."""
    assert path.stat().st_size < 1_000_000


@pytest.mark.thorough
def test_hostile_names_are_text(page):
    """Assert that a file and columns with markup for names are shown so, and do nothing."""
    assert FILE in page.locator(".subject").inner_text()
    assert FILE in page.title()
    origin = page.locator("#origin").inner_text()
    assert f"{HOSTILE}motor_torque in N m" in origin
    assert FILE in origin
    assert page.locator("img, script").count() == 0
    assert (page.watched.requests, page.watched.complaints) == ([page.url], [])


@pytest.mark.thorough
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_the_first_screen_answers(page, width, height):
    """Assert that all parameters, the trust and the next step are seen without scrolling."""
    page.set_viewport_size({"width": width, "height": height})
    rows = page.locator(".lead tbody tr")
    assert rows.count() == 5
    words = page.locator(".answer .word")
    assert words.all_inner_texts() == ["Yes", "Test it on another log"]
    ends = [*rows.all(), *words.all(), page.locator(".answer pre").last]
    for element in ends:
        box = element.bounding_box()
        assert box["y"] >= 0.0
        assert box["y"] + box["height"] <= height
        assert box["x"] + box["width"] <= width
    assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.thorough
def test_parameters_are_as_printed(page, estimate):
    """Assert that the table has what the terminal has: names, values, intervals, verdicts."""
    printed = estimate.summary()
    for row in page.locator(".lead tbody tr").all():
        name, value, interval, unit, verdict = row.locator("th, td").all_inner_texts()
        line = next(line for line in printed.splitlines() if line.startswith(f"{name} "))
        assert line.split("  ")[0] == name
        shown = unit.replace("²", "^2")
        assert all(text in line for text in (value, interval, shown, verdict))


@pytest.mark.thorough
def test_every_figure_has_its_sentence(page, estimate):
    """Assert that all charts are there, each with what to see in it."""
    charts = identification_charts(estimate.result)
    assert page.locator(".chart.wide").count() == len(charts) >= 6
    assert page.locator("figcaption").all_inner_texts() == [chart.says for chart in charts]


def test_a_loaded_estimate_has_a_page(estimate, tmp_path):
    """Assert that without time series the page leaves out their figures, and nothing else."""
    estimate.save(tmp_path / "estimate.json")
    loaded = flexid.load(tmp_path / "estimate.json")
    page = identification_page(loaded.result, identification_charts(loaded.result))
    names = [section.name for section in page.sections]
    assert "estimates" not in names
    assert {"fit", "bode", "choices", "origin"} <= set(names)
    assert page.lead.rows == identification_page(estimate.result, ()).lead.rows


def verdicts(*of_parameters: str, coefficient: str = "determined", **more):
    """Return a result whose parameters, and whose last coefficient, have these verdicts."""
    made = made_result(ModelError(0.05, 0.9, 0.0))
    (known,) = made.parameters.values()
    parameters = {
        f"p{i}": replace(known, name=f"p{i}", verdict=verdict, reason="is wide")
        for i, verdict in enumerate(of_parameters)
    }
    coefficients = dict(made.coefficients)
    last = coefficients["alpha_coulomb"]
    coefficients["alpha_coulomb"] = replace(last, verdict=coefficient)
    changes = {"warnings": (), **more}
    return replace(made, parameters=parameters, coefficients=coefficients, **changes)


@pytest.mark.parametrize(
    ("result", "word", "tone", "said"),
    [
        (verdicts("determined"), "Yes", "good", "The only one is determined."),
        (
            verdicts("determined", warnings=("w",)),
            "With care",
            "fair",
            "The only one is determined.",
        ),
        (
            verdicts("determined", coefficient="weak"),
            "With care",
            "fair",
            "The only one is determined, but not alpha_coulomb.",
        ),
        (
            verdicts("determined", "weak"),
            "With care",
            "fair",
            "Of 2: 1 determined, 1 weak.",
        ),
        (
            verdicts("determined", "weak", "undetermined"),
            "Not all of them",
            "bad",
            "Of 3: 1 determined, 1 weak, 1 undetermined.",
        ),
        (verdicts("undetermined"), "No", "bad", "The only one is not determined."),
        (
            verdicts(
                "determined", validation=replace(VALIDATION, fit_percent={"deflection": -865.0})
            ),
            "With care, and not for long predictions",
            "bad",
            "The only one is determined.",
        ),
    ],
)
def test_trust_follows_verdicts_and_warnings(result, word, tone, said):
    """Assert that the first answer is the worst of verdicts and warnings, in a word and a tone."""
    answer = trust(result)
    assert (answer.word, answer.tone) == (word, tone)
    assert str(answer.content[0]) == said


@pytest.mark.parametrize(
    ("result", "word", "command"),
    [
        (verdicts("determined"), "Test it on another log", "flexid validate e.json NEXT.csv"),
        (verdicts("weak", "undetermined"), "Record another motion", "flexid excitation LOG"),
        (
            verdicts("weak", model_error=ModelError(2.0, 0.9, 0.5)),
            "Look for what the model lacks",
            "flexid excitation LOG",
        ),
    ],
)
def test_the_next_step_follows_what_is_lacking(result, word, command):
    """Assert that an estimate is tested, a motion improved, or a model doubted."""
    answer = next_step(result, "e.json")
    assert answer.word == word
    worst = [name for name, p in result.parameters.items() if p.verdict == "undetermined"]
    reasons = [item.lines[0] for item in answer.content if isinstance(item, Bullets)]
    assert not worst or reasons == [f"{worst[0]}: is wide"]
    (found,) = [item for item in answer.content if isinstance(item, Command)]
    assert found.text == command


def test_the_confounded_pair_is_named():
    """Assert that of rows that are hardly excited the pair that correlates most is named."""
    bad = excitation_of_gram("link", ["a", "b"], np.array([[1.0, 0.9999], [0.9999, 1.0]]))
    good = excitation_of_gram("motor", ["c", "d"], np.array([[1.0, 0.3], [0.3, 1.0]]))
    answer = next_step(verdicts("weak", excitation={"motor": good, "link": bad}), "")
    (reasons,) = [item for item in answer.content if isinstance(item, Bullets)]
    assert reasons.lines[1:] == ["a and b are hardest to tell apart: they correlate by 1.000"]
    answer = next_step(verdicts("weak", excitation={"motor": good}), "")
    (reasons,) = [item for item in answer.content if isinstance(item, Bullets)]
    assert len(reasons.lines) == 1


def test_advice_takes_the_commands_place():
    """Assert that what to record stands on the first screen, and all of it in a section."""
    result = verdicts("weak")
    answer = next_step(result, "", ("Add a sine.", "Or record 20 s."))
    assert "Add a sine." in [str(item) for item in answer.content]
    assert not any(isinstance(item, Command) for item in answer.content)
    page = identification_page(result, (), advice=("Add a sine.", "Or record 20 s."))
    (section,) = [section for section in page.sections if section.name == "next"]
    assert section.content[0] == Bullets(("Add a sine.", "Or record 20 s."))


def test_the_command_repeats_the_settings(flexid, monkeypatch, examples):
    """Assert that the command line reads the same settings from the command on the page."""
    settings = Settings(
        model="flexible",
        terms=("gravity", "motor_viscous"),
        known={"motor_inertia": 0.3, "joint_stiffness": 100.0},
        known_deviations={"motor_inertia": 0.01},
        bounds={"link_inertia": (0.5, float("inf"))},
        hold="linear",
        input_delay=0.001,
        filter_rate=25.0,
        segment_duration=1.5,
        validation_share=0.25,
    )
    seen = []

    def stop(_logs, given, *_others):
        seen.append(given)
        raise KeyboardInterrupt

    log = examples / "flexible_joint.csv"
    provenance = {"settings": asdict(settings), "inputs": [{"file": str(log)}]}
    command = identification_command(replace(made_result(), provenance=provenance))
    monkeypatch.setattr("flexid.identification.identify.identify", stop)
    flexid(*shlex.split(command)[1:])
    assert seen == [settings]


def test_what_was_typed_is_on_the_page(estimate):
    """Assert that a command that is given stands on the page as it is."""
    page = identification_page(estimate.result, (), "flexid identify a b --columns 'my map.toml'")
    (origin,) = [section for section in page.sections if section.name == "origin"]
    command, facts = origin.content
    assert isinstance(command, Command)
    assert command.text == "flexid identify a b --columns 'my map.toml'"
    assert isinstance(facts, Facts)
    assert ("filter rate", "20 1/s") in facts.entries


def from_columns(**origins):
    """Provenance of a log whose channels were computed so."""
    usual = {"factor": 1.0, "offset": 0.0, "unit": "rad", "gear_ratio": None}
    columns = {channel: {**usual, **origin} for channel, origin in origins.items()}
    return {"inputs": [{"file": "a.csv", "columns": columns}]}


NAMED = {"columns": {"q_link [deg]": 1.0}, "factor": np.pi / 180.0}


@pytest.mark.parametrize(
    ("origin", "mapped"),
    [
        (NAMED, False),
        ({"columns": {"/arm/states.link_position": 1.0}}, False),
        ({**NAMED, "factor": -np.pi / 180.0}, True),
        ({**NAMED, "gear_ratio": 100.0}, True),
        ({**NAMED, "offset": 0.1}, True),
        ({"columns": {"q_link": 1.0, "q_motor": -1.0}}, True),
        ({"columns": {"channel 3": 1.0}}, True),
    ],
)
def test_a_column_map_is_part_of_what_repeats_it(origin, mapped):
    """Assert that a channel that no name explains needs a map, and that this is said."""
    result = replace(made_result(), provenance=from_columns(link_position=origin))
    page = identification_page(result, ())
    (section,) = [section for section in page.sections if section.name == "origin"]
    command, *said, _ = section.content
    assert isinstance(command, Command)
    assert command.text.endswith("--columns MAP.toml") is mapped
    assert [str(line).startswith("MAP.toml stands for") for line in said] == [True] * mapped
