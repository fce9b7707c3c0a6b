"""Where an answer comes from: logs, settings, and the command that repeats it."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from math import isclose, isfinite
from typing import Any

from flexid.identification.preparation.settings import Settings
from flexid.identification.result.identification import Identification
from flexid.recording.columns import is_by_name

_USUAL = Settings()
COLUMN_MAP = "MAP.toml"
"""What stands for a column map, whose name no estimate holds."""

_CHOSEN = ("hold", "input_delay", "link_delay", "coulomb_velocity", "filter_rate")


def identification_command(result: Identification) -> str:
    """The command that repeats an identification; see `mapped` for its column map.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> settings = {"known": {"motor_inertia": 0.3}, "known_deviations": {"motor_inertia": 0.01}}
    >>> provenance = {"settings": settings, "inputs": [{"file": "my log.csv"}]}
    >>> identification_command(SimpleNamespace(provenance=provenance))
    "flexid identify 'my log.csv' --known motor_inertia=0.3+-0.01"
    """
    return _command("identify", result, ["--stream"] if "stream" in result.provenance else [])


def excitation_command(result: Identification) -> str:
    """The command that says what motion to add, with the same logs and settings."""
    return _command("excitation", result, [])


def _command(name: str, result: Identification, more: list[str]) -> str:
    logs = result.provenance.get("inputs", ())
    files = [str(source.get("file") or "LOG") for source in logs] or ["LOG"]
    options = [*_options(result.provenance.get("settings", {}))]
    if mapped(result.provenance):
        options += ["--columns", COLUMN_MAP]
    return shlex.join(["flexid", name, *files, *options, *more])


def mapped(provenance: Mapping[str, Any]) -> bool:
    """Whether a channel was computed as no column's name says, but a column map."""
    return any(
        not is_by_name(channel, origin)
        for source in provenance.get("inputs", ())
        for channel, origin in source.get("columns", {}).items()
    )


def _options(settings: Mapping[str, Any]) -> Iterator[str]:
    """Options of the command line for settings that are not the usual ones."""
    if settings.get("model", "auto") != "auto":
        yield from ("--model", settings["model"])
    if settings.get("terms", "auto") != "auto":
        yield from ("--terms", ",".join(settings["terms"]))
    deviations = settings.get("known_deviations") or {}
    for name, value in (settings.get("known") or {}).items():
        spread = f"+-{deviations[name]:.10g}" if name in deviations else ""
        yield from ("--known", f"{name}={value:.10g}{spread}")
    for name, (low, high) in (settings.get("bounds") or {}).items():
        yield from ("--bounds", f"{name}={_end(low)}:{_end(high)}")
    for name in (*_CHOSEN, "segment_duration"):
        value = settings.get(name, "auto")
        if value not in ("auto", None):
            text = value if isinstance(value, str) else f"{value:.10g}"
            yield from (f"--{name.replace('_', '-')}", text)
    share = settings.get("validation_share", _USUAL.validation_share)
    if not isclose(share, _USUAL.validation_share):
        yield from ("--validation-share", f"{share:.10g}")


def _end(value: float | None) -> str:
    return "" if value is None or not isfinite(value) else f"{value:.10g}"


def input_facts(provenance: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Version and logs: each with its digest, and what its channels are made of."""
    yield "flexid", str(provenance.get("flexid_version", "unknown"))
    if "estimate" in provenance:
        yield "estimate", str(provenance["estimate"].get("file") or "in memory")
    for source in provenance.get("inputs", ()):
        yield "log", str(source.get("file") or "data in memory")
        if source.get("sha256"):
            yield "SHA-256", str(source["sha256"])
        for channel, origin in source.get("columns", {}).items():
            yield channel.replace("_", " "), _origin(origin)


def _origin(origin: Mapping[str, Any]) -> str:
    """A channel as a formula of the file's columns, in SI units."""
    terms = [
        name if weight == 1.0 else f"{weight:.6g} × {name}"
        for name, weight in origin["columns"].items()
    ]
    total = " + ".join(terms)
    factor, offset = origin["factor"], origin["offset"]
    if factor != 1.0:
        total = f"{factor:.6g} × ({total})" if len(terms) > 1 else f"{factor:.6g} × {total}"
    shift = f" + {offset:.6g}" if offset else ""
    gear = f", carried through a gear of {origin['gear_ratio']:.6g}" if origin["gear_ratio"] else ""
    return f"{total}{shift} in {origin['unit']}{gear}"


def chosen_facts(provenance: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """What was chosen from the log, or given."""
    chosen = provenance.get("chosen", {})
    if chosen.get("terms") is not None:
        yield "terms", ", ".join(chosen["terms"]) or "none"
    for name, unit in (
        ("input_delay", "s"),
        ("link_delay", "s"),
        ("filter_rate", "1/s"),
        ("segment_duration", "s"),
    ):
        if chosen.get(name) is not None:
            yield name.replace("_", " "), f"{chosen[name]:.6g} {unit}"
    for name in ("hold", "estimator"):
        if chosen.get(name) is not None:
            yield name, str(chosen[name])
