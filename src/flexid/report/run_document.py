"""A simulated run as a plain document for JSON."""

from typing import Any

import flexid
from flexid.experiments.experiment import Experiment
from flexid.experiments.measures import Measures
from flexid.report.documents import excitation_summary
from flexid.simulation.run import Run


def run_document(experiment: Experiment, run: Run, measures: Measures) -> dict[str, Any]:
    """Everything of a run but its time series; SI units."""
    true = experiment.loop.coefficients
    return {
        "name": experiment.name,
        "status": "finished",
        "reached": float(run.time[-1]),
        "coefficients": {
            name: {
                "true": true[name],
                "initial": experiment.loop.initial_estimates.get(name, 0.0),
                "final": float(run.estimates[-1, place]),
                "final_error": measures.final_errors[name],
                "settling_time": measures.settling_times[name],
            }
            for place, name in enumerate(experiment.loop.system.coefficients)
        },
        "final_states": measures.final_states,
        "tracking_rms": measures.tracking_rms,
        "tracking_peak": measures.tracking_peak,
        "peak_inputs": measures.peak_inputs,
        "excitation": {row: excitation_summary(e) for row, e in measures.excitation.items()},
        "statistics": run.statistics,
        "provenance": {
            "flexid_version": flexid.__version__,
            "experiment": experiment.path,
            "experiment_digest": experiment.digest,
            "mode": experiment.mode,
            "settings": experiment.settings.model_dump(),
            "tables": experiment.tables.model_dump(),
        },
    }
