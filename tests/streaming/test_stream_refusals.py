"""Streams and their options that are refused, each in one sentence with a remedy."""

import gzip
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from moving_joint import CHOSEN, OPTIONS, H, options_of

import flexid
from flexid.library.watched import Watch
from flexid.streaming.incoming import Replay, TextStream, open_source, sample_time_of
from flexid.streaming.options import WatchOptions, check_comparable, chosen_channels, wanted_kind

CLOCKS = {
    **{f"samples of {each} s": {"sample_time": each} for each in (0.0, 1e-320, np.nan, 0.51)},
    **{f"a filter of {rate}": {"filter_rate": rate} for rate in (0.0199, 1e-320, 63.0)},
}
KNOWN: dict[str, dict[str, Any]] = {
    "a name that is none": {"known": {"magic": 1.0}},
    "a term that is left out": {"known": {"joint_damping": 1.0}},
    "a negative inertia": {"known": {"motor_inertia": -1.0}},
    "an inertia beside a current": {"known": {"motor_inertia": 1.0}, "input_unit": "A"},
    "a term that remembers": {"terms": ("spring_hysteresis",)},
    "a play of no width": {"terms": ("backlash",)},
}
ALONE: Any = {"time": None, "motor_position": None}
SPEEDS: Any = {"time": None, "motor_velocity": None, "motor_torque": None}
FAST: Any = ALONE | {"link_velocity": None, "motor_torque": None}
SETTINGS: dict[str, Callable[[], object]] = {
    **{name: partial(WatchOptions, **{"sample_time": H} | one) for name, one in CLOCKS.items()},
    **{name: partial(replace, OPTIONS, **one) for name, one in KNOWN.items()},
    "a term of two encoders": lambda: options_of(kind="rigid", terms=("joint_damping",)),
    "a term of the motor": lambda: options_of(kind="link", terms=("motor_drag",)),
    "a term of one encoder": lambda: options_of(kind="flexible", terms=("viscous",)),
    "a transition velocity of zero": lambda: options_of(coulomb_velocity=0.0),
    "another kind": lambda: wanted_kind({"kind": "elastic"}, None),
    "a hold without an input": lambda: WatchOptions(H, (), "link", hold="zero"),
    "a motor alone": lambda: chosen_channels("log", ALONE, ()),
    "a link that is not there": lambda: chosen_channels("log", ALONE, (), "link"),
    "a motor's velocity": lambda: chosen_channels("log", SPEEDS, ()),
    "a link's velocity": lambda: chosen_channels("log", FAST, ()),
    "an empty estimate": lambda: flexid.watch(sample_time=H, estimate={}),
}
HEADER = "time [ms],motor current [A],link_position [deg],motor_position [rad]"
ROWS = [f"{2 * k},0.1,{k % 7},{k % 5}" for k in range(200)]
STAMPS = [row[:-1] + ("10:00:00.5" if k < 170 else "fault") for k, row in enumerate(ROWS)]


def stream_of(*lines: str) -> bytes:
    """Return a stream of these lines."""
    return "\n".join([*lines, ""]).encode()


GOOD = stream_of(HEADER, *ROWS)
STREAMS = {
    "no torque": stream_of("time,x,motor_position,y", *ROWS),
    "no motor": stream_of("time,foo,bar,motor_torque", *ROWS),
    "a unit that is none": stream_of("time,link_position [parsec],motor_position,tau", *ROWS),
    "gzip": gzip.compress(GOOD) + b"\n" * 4,
    "UTF-16": GOOD.decode().encode("utf-16"),
    "null bytes": GOOD.replace(b",", b"\0"),
    "too few rows": b"time,motor_torque\n1,2\n",
    "stamps for numbers": stream_of(HEADER, *ROWS[:90], *STAMPS[90:]),
}
TIMES = {"steps of 20 s": 20.0 * np.arange(200.0), "no times": np.full(200, np.nan)}
SOURCES = ("tcp://127.0.0.1:9000", "no/such/file.csv", ".")


def test_streams_that_are_refused(here: Path, refusals: Any) -> None:
    """Assert that unusable streams are refused, and that the limits themselves are accepted."""
    pl.DataFrame({"time": [0.0, 1.0], "motor_position": [0.0, 1.0]}).write_parquet("log.parquet")
    headed = Watch("log.parquet", CHOSEN, header="time")
    long = TextStream("stream", fewest=4)
    assert len(long.samples(GOOD + b"1" * 1_000_001)) == len(ROWS)
    refusals(
        SETTINGS
        | {n: partial(TextStream("stream").samples, raw, ended=True) for n, raw in STREAMS.items()}
        | {name: partial(sample_time_of, "stream", time) for name, time in TIMES.items()}
        | {name: lambda name=name: next(open_source(name)) for name in SOURCES}
        | {
            "a line without an end": lambda: long.samples(b"1"),
            "a log without a torque": lambda: Replay(Path("log.parquet"), None),
            "a header of a log": lambda: next(iter(headed.turns())),
        }
    )
    for rate in (0.0201, 62.0):
        WatchOptions(sample_time=H, filter_rate=rate)


def test_estimates_that_no_stream_is_compared_with(example_estimate: Any, refusals: Any) -> None:
    """Assert that an estimate of another joint or input, with hysteresis or gaps, is refused."""
    made = example_estimate.result
    with_memory = replace(made.choices, terms=("gravity", "spring_hysteresis"))
    missing = replace(made.coefficients["beta1"], value=np.nan, std=0.0)
    open_ones = {n: replace(p, verdict="undetermined") for n, p in made.parameters.items()}
    others = {
        "a spring that remembers": replace(made, choices=with_memory),
        "a missing value": replace(made, coefficients=made.coefficients | {"beta1": missing}),
        "nothing determined": replace(made, parameters=open_ones),
    }
    refusals(
        {
            "another joint": lambda: options_of(made, "rigid"),
            "another input": lambda: options_of(made, unit="A"),
            **{name: partial(check_comparable, other) for name, other in others.items()},
        }
    )
