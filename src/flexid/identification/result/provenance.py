"""Where a result comes from: version, settings, what was chosen, and the files' hashes."""

from collections.abc import Sequence
from dataclasses import asdict

import flexid
from flexid.identification.preparation.joint import Kind
from flexid.identification.preparation.settings import Settings
from flexid.identification.result.identification import Choices
from flexid.recording.recording import Log


def provenance(
    logs: Sequence[Log], settings: Settings, model: Kind, choices: Choices
) -> dict[str, object]:
    """What it takes to repeat a result."""
    return {
        "flexid_version": flexid.__version__,
        "settings": asdict(settings),
        "chosen": {
            "model": model,
            "terms": list(choices.terms),
            "hold": choices.hold,
            "input_delay": choices.alignment.input_delay.value,
            "link_delay": choices.alignment.link_delay.value,
            "coulomb_velocity": choices.coulomb_velocity,
            "filter_rate": round(choices.filter_rate, 6),
            "estimator": choices.estimator,
            "segment_duration": choices.segment_duration,
        },
        "inputs": [log.provenance for log in logs],
    }
