"""``flexid watch SOURCE``: parameters beside a running drive."""

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexid.cli.exit_status import ExitStatus
from flexid.cli.options import AsJson, Columns, Known, Model, known_pairs
from flexid.cli.output import print_warnings
from flexid.errors import SettingError

if TYPE_CHECKING:
    from rich.console import Console

    from flexid.streaming.follower import Follower
    from flexid.streaming.session import Session

EXAMPLES = (
    "watch examples/flexible_joint.csv --stop-at-end",
    "watch run.csv --checkpoint run.checkpoint",
    "watch udp://127.0.0.1:9000 --json",
    "watch run.csv --estimate results/estimate.json --memory 60",
    "watch 'serial:///dev/ttyUSB0?baud=921600' --columns drive.toml",
)

_SAVED_EVERY = 60.0  # s
_DRAWN_EVERY = 0.2  # s


def watch(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="A text file that may grow, - for standard input, udp://127.0.0.1:PORT, "
            "serial:///dev/PORT?baud=RATE, or an MCAP file or another log, played at its own pace.",
            show_default=False,
        ),
    ],
    columns: Columns = None,
    header: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Names of the columns, where the source does not begin with them: "
            "'time [s],link_position [deg],motor_position [deg],motor_torque [N m]'.",
        ),
    ] = None,
    sample_time: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Without it, that of the first time stamps."),
    ] = None,
    estimate: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The estimate.json of flexid identify to hold the drive against: its model, terms "
            "and filter are taken, and where the drive departs from its values, that is said.",
        ),
    ] = None,
    known: Known = None,
    model: Model = "auto",
    terms: Annotated[
        str,
        typer.Option(
            metavar="NAMES",
            help="Terms of the model beside the joint spring, between commas; usual: those of the "
            "estimate, or gravity,motor_viscous,joint_damping,motor_coulomb.",
        ),
    ] = "usual",
    hold: Annotated[
        str,
        typer.Option(
            metavar="WORD",
            help="How the input behaves between samples: zero (held) or linear; auto: as in the "
            "estimate, or the intervals are wider by what it matters.",
        ),
    ] = "auto",
    filter_rate: Annotated[
        float | None,
        typer.Option(
            metavar="1/S",
            show_default="that of the estimate, or 20",
            help="Rate of the filter of least squares.",
        ),
    ] = None,
    memory: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            show_default="endless",
            help="Time after which a sample counts 1/e as much.",
        ),
    ] = inf,
    coulomb_velocity: Annotated[
        float | None,
        typer.Option(
            metavar="RAD/S",
            show_default="that of the estimate, or 0.1",
            help="Velocity over which Coulomb friction changes its sign.",
        ),
    ] = None,
    checkpoint: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Go on from this file, if it is there, and save into it: each minute, at the end, "
            "and on Ctrl-C.",
        ),
    ] = None,
    every: Annotated[
        float, typer.Option(metavar="SECONDS", help="Time of the stream between two JSON lines.")
    ] = 1.0,
    stop_at_end: Annotated[
        bool,
        typer.Option(
            "--stop-at-end",
            help="Stop at the end of a file: do not wait for more, nor play at its own pace.",
        ),
    ] = False,
    duration: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Stop after so long.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Estimate a drive's parameters while it runs.

    Samples are lines of numbers below a header, as in a log. What is wrong with them is left out,
    counted and said: outliers, gaps, late and repeated samples, encoders that stick, inputs at
    their limit. Without an input the link alone is watched, driven by the motor's measured motion.
    With --estimate the drive is held against what it was: the health is inconsistent where it
    departs from that, and says in what and by how much. In a terminal the view is renewed; with
    --json each report is one line.

    Exit status: 0 where the estimates had converged in the end, 1 where they had not, 2 for bad
    input, be it in the middle, 3 for Ctrl-C; the last report and the checkpoint are there all the
    same.
    """
    from rich.console import Console

    from flexid.library.watch import watch as run

    watched = run(
        source,
        columns=columns,
        header=header,
        sample_time=sample_time,
        estimate=estimate,
        known=known_pairs("--known", known or []),
        model=model,  # type: ignore[arg-type] - the library checks it
        terms=terms,
        hold=hold,  # type: ignore[arg-type] - the library checks it
        filter_rate=filter_rate,
        memory=memory,
        coulomb_velocity=coulomb_velocity,
        checkpoint=checkpoint,
        every=every,
        stop_at_end=stop_at_end,
        duration=duration,
    )
    follower = watched.follower
    assert follower is not None  # there is a source
    errors = Console(stderr=True)
    with _interruptions() as asked:
        failure = None
        try:
            _follow(follower, every, checkpoint, asked, errors, as_json=as_json)
        except Exception as error:  # whatever it is, it must not cost what was learnt before
            failure = error
        session = follower.session
        if session is not None:
            _end(session, checkpoint, as_json=as_json)
        if failure is not None:
            raise failure
    if asked:
        signal.raise_signal(asked[0])  # as if it came now, when all is saved
    from flexid.streaming.health import Health

    if session is None or session.health.health is not Health.CONVERGED:
        raise typer.Exit(ExitStatus.LACKING)


@contextmanager
def _interruptions() -> Iterator[list[int]]:
    """Signals that came meanwhile: samples are taken in whole, and the second one is obeyed."""
    asked: list[int] = []
    before: dict[int, Any] = {}

    def noted(number: int, _frame: FrameType | None) -> None:
        asked.append(number)
        signal.signal(number, before[number])

    for number in (signal.SIGINT, signal.SIGTERM):
        before[number] = signal.signal(number, noted)
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _follow(
    follower: "Follower",
    every: float,
    checkpoint: Path | None,
    asked: list[int],
    errors: "Console",
    *,
    as_json: bool,
) -> None:
    """Follow the stream until it ends, or an interruption; show what is known meanwhile."""
    from rich.live import Live

    from flexid.report.watch_table import Sparks, live_view

    saved = drawn = time.monotonic()
    warned = 0
    sparks = Sparks()
    terminal = not as_json and errors.is_terminal
    live = Live(console=errors, transient=True, auto_refresh=False)
    with live if terminal else _nothing():
        for due in follower.turns(every):
            print_warnings(follower.warnings[warned:], errors)
            warned = len(follower.warnings)
            session, now = follower.session, time.monotonic()
            if due and as_json and session is not None:
                _print_line(session)
            if terminal and now - drawn > _DRAWN_EVERY:
                live.update(live_view(session, sparks, errors.width), refresh=True)
                drawn = now
            if checkpoint is not None and session is not None and now - saved > _SAVED_EVERY:
                _save_meanwhile(session, checkpoint, errors)
                saved = now
            if asked:
                break


@contextmanager
def _nothing() -> Iterator[None]:
    yield


def _save(session: "Session", checkpoint: Path) -> None:
    from flexid.streaming.checkpoint import save_session

    save_session(session, checkpoint)


def _save_meanwhile(session: "Session", checkpoint: Path, errors: "Console") -> None:
    """Save, or warn: there may be room again in a minute, and the drive runs on."""
    try:
        _save(session, checkpoint)
    except SettingError as error:
        print_warnings((str(error),), errors)


def _end(session: "Session", checkpoint: Path | None, *, as_json: bool) -> None:
    """Save, then print the last report: a reader that has gone must not cost the checkpoint."""
    from flexid.report.terminal import print_parts
    from flexid.report.watch_table import watch_parts

    try:
        if checkpoint is not None:
            _save(session, checkpoint)
    finally:  # a full disk must not cost the report
        if as_json:
            _print_line(session)
        else:
            print_parts(watch_parts(session))


def _print_line(session: "Session") -> None:
    import json

    from flexid.report.documents import to_json
    from flexid.report.watch_document import watch_document

    document = json.loads(to_json(watch_document(session)))
    typer.echo(json.dumps(document))
