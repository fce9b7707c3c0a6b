"""Typed values, and refusals of the command line: status 2, one sentence, and no output."""

import shlex
import shutil
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

import pytest
from tests.campaigns.tiny import write_experiment

from flexid.arrays import to_json
from flexid.cli.commands import command_line
from flexid.cli.options import parse_bounds, parse_known, parse_number, parse_values
from flexid.stored_estimates.estimate_file import estimate_document
from made_estimates import TRUE, exact

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a valid file of each kind, and invalid ones."""
    folder = tmp_path_factory.mktemp("refused")
    write_experiment(folder / "tiny.toml")
    write_experiment(folder / "single.toml", campaign="")
    (folder / "a.json").write_text(to_json(estimate_document(exact(TRUE, "a"))))
    (folder / "empty").mkdir()
    log = (ROOT / "examples" / "flexible_joint.csv").read_text()
    texts = {
        "other.json": '{"model": "flexible"}',
        "good.csv": log,
        "again.csv": log,
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    shutil.copy(ROOT / "experiments" / "huang2003.toml", folder)
    return folder


REFUSED = (
    ("campaign", "EXPERIMENT: is missing"),
    ("campaign tiny.toml", "--out: is missing"),
    ("campaign tiny.toml --summary out", "EXPERIMENT: does not go with summary"),
    ("campaign --summary out --workers 2", "--workers: does not go with summary"),
    ("campaign tiny.toml --out out --scheduler x --workers 2", "--workers: is for"),
    ("campaign single.toml --out out", "the key 'campaign' is missing"),
    ("compare a.json other.json --out out", "is no estimate: give an estimate.json"),
    ("compare a.json empty --out out", "give the path of an estimate.json"),
    ("simulate a.json", "a.json: is JSON, like a saved estimate: give a TOML file"),
    ("derive flexible-joint --to fortran", "latex, python, c"),
    ("derive model.toml --terms gravity", "terms: is for flexible-joint"),
    ("derive model.toml --unknown-input-gain", "unknown-input-gain: is for flexible-joint"),
    ("watch good.csv --memory 0.01", "give more than"),
    ("identify good.csv again.csv --stream", "only one log can be streamed"),
    ("reproduce --out good.csv", "--out"),
    ("identify --columns= good.csv", "--columns: its name is empty"),
    ("identify ''", "LOG: its name is empty"),
    ("export a.json --to mjcf --memory 5 --out out", "--memory: is for the online estimator"),
    ("export a.json --to c99 --sample-time 0.001 --terms gravity --out out", "--terms: is for"),
    ("identify good.csv --terms auto,gravity", "'auto' is unknown: there are gravity"),
    ("campaign tiny.toml --out out --workers 0", "--workers: must be at least 1, got 0"),
    ("simulate huang2003.toml --set controller.k", "path=number"),
    ("simulate huang2003.toml --out huang2003.toml", "cannot be written (file exists): name"),
    ("simulate huang2003.toml --csv", "nowhere to write"),
    ("studio missing.csv --no-browser --port 0", "missing.csv: there is no such file"),
    ("validate none.json good.csv", "none.json"),
    ("validate a.json good.csv --min-fit nan", "--min-fit: must be 100 % or less, got nan"),
    ("watch", "SOURCE: is missing"),
    ("watch udp://127.0.0.1:9000", "let another program write"),
    ("watch good.csv --every 0", "must be above 0 s, got 0.0"),
)


@pytest.mark.parametrize(("arguments", "said"), REFUSED, ids=[each for each, _ in REFUSED])
def test_a_refusal_is_one_sentence(flexid, folder, monkeypatch, arguments, said):
    """Assert that the error is named in one line, and that no file is written."""
    monkeypatch.chdir(folder)
    outcome = flexid(*shlex.split(arguments))
    assert outcome.status == 2
    assert outcome.stdout == ""
    (line,) = outcome.stderr.splitlines()
    assert line.startswith("flexid: ")
    assert said in line
    assert not (folder / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("identify", "Missing argument 'LOG...'"),
        ("compare a.json", "Missing argument 'B'"),
        ("export a.json --out out", "Missing option '--to'"),
        ("export a.json --to mjcf", "Missing option '--out'"),
    ],
)
def test_what_is_missing_is_named_as_it_is_typed(flexid, folder, monkeypatch, arguments, said):
    """Assert that a usage error names the missing argument."""
    monkeypatch.chdir(folder)
    outcome = flexid(*shlex.split(arguments))
    assert (outcome.status, outcome.stdout) == (2, "")
    assert said in outcome.stderr


SEED = 2**62 + 1
READ = [
    # A value and its standard deviation, in either notation; not confused with an exponent's sign.
    *(
        (parse_known, [text], {"theta2": (100.0, 5.0)})
        for text in ("theta2=100+-5", "theta2 = 100 ± 5", "theta2 = 100 +/- 5", "theta2=1e2+-5e+0")
    ),
    (parse_known, ["beta1=1e+3", "alpha1=1e-3"], {"beta1": 1000.0, "alpha1": 0.001}),
    # A missing end is infinite.
    (parse_bounds, ["alpha2=0:"], {"alpha2": (0.0, inf)}),
    (parse_bounds, ["alpha2=:2"], {"alpha2": (-inf, 2.0)}),
    (parse_bounds, ["alpha2= -1e3 : 2 "], {"alpha2": (-1000.0, 2.0)}),
    (parse_number, "2e-3", 0.002),
    (parse_number, "auto", "auto"),
    # A seed of 63 bits is not rounded.
    (parse_values, [f"sampling.seed={SEED}"], {"sampling.seed": SEED}),
    (parse_values, ["a.b=1e3", "a.c = -2", "a.d=inf"], {"a.b": 1000.0, "a.c": -2, "a.d": inf}),
]


@pytest.mark.parametrize(("parse", "given", "expected"), READ)
def test_what_is_read(parse, given, expected):
    """Assert that typed assignments become values by name."""
    assert parse("--option", given) == expected


UNREADABLE = [
    *((parse_known, [f"theta2{end}"]) for end in ("", "=", "=a", "=1+-", "=+-1")),
    *((parse_bounds, [text]) for text in ("alpha2", "alpha2=1", "alpha2=a:b", "alpha2=1:2:3")),
    # A second value does not replace the first.
    (parse_known, ["beta1=3", "beta1=4"]),
    (parse_bounds, ["beta1=3:", "beta1 = :4"]),
    (parse_number, "soon"),
]


def test_what_is_refused(refusals):
    """Assert that an invalid assignment is refused with the text that was typed."""
    refusals({str(given): partial(parse, "--option", given) for parse, given in UNREADABLE})


def test_what_is_typed_is_what_the_library_gets():
    """Assert that a typed value is used as it is, even if it equals the help's rounded default."""
    given = {}
    command: Any = command_line("identify").commands["identify"]
    command.run = lambda _command, options, _flags: given.update(options)
    command.main(["a.csv", "--validation-share", "0.333"], standalone_mode=False)
    assert given == {"logs": ("a.csv",), "validation_share": 0.333}
