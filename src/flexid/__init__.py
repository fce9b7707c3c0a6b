"""flexid: physical parameters of flexible-joint drives from their motion, without accelerations.

Every command is a function here; each name is loaded when it is first used, so that importing
flexid costs next to nothing. ``__init__.pyi`` says the same to whatever checks types.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_HOMES = {
    # the commands
    "identify": "library.identify",
    "validate": "library.validation",
    "compare": "library.validation",
    "excitation": "library.excitation",
    "design": "library.excitation",
    "derive": "library.export",
    "export": "library.export",
    "simulate": "library.simulate",
    "campaign": "library.simulate",
    "reproduce": "library.simulate",
    "watch": "library.watch",
    # logs, and estimates that were saved
    "load": "library.identify",
    "read_log": "library.logs",
    "samples": "library.logs",
    "mujoco_log": "library.python_control",
    "Log": "recording.recording",
    "Recording": "recording.recording",
    "Samples": "estimators.samples",
    # what the commands return
    "JointEstimate": "library.joint_estimate",
    "EstimateValidation": "library.validation",
    "EstimateComparison": "library.validation",
    "Prediction": "library.validation",
    "FrequencyResponse": "frequency.frequency_response",
    "LogExcitation": "library.excitation",
    "ExperimentDesign": "library.excitation",
    "ExportedFiles": "library.export",
    "SimulatedRun": "library.simulate",
    "CampaignResult": "library.simulate",
    "PaperReproduction": "library.simulate",
    "Watch": "library.watch",
    "Health": "streaming.health",
    "Thresholds": "identification.vocabulary.thresholds",
    # models
    "ParametricSystem": "models.parametric_system",
    "Row": "models.parametric_system",
    "flexible_joint": "models.flexible_joint",
    "rigid_joint": "models.rigid_joint",
    "read_model": "models.model_file",
    "TERMS": "models.flexible_joint",
    "SHAPE_TERMS": "models.flexible_joint",
    # estimators next to a drive
    "OnlineEstimator": "estimators.online",
    "History": "estimators.online",
    "Status": "estimators.online",
    "recursive_least_squares": "estimators.recursive_least_squares",
    "parametric_observer": "estimators.parametric_observer",
    # for python-control
    "plant_io_system": "library.python_control",
    "controller_io_system": "library.python_control",
    "observer_io_system": "library.python_control",
    "estimator_io_system": "library.python_control",
    "loop_io_system": "library.python_control",
    # errors
    "FlexidError": "errors",
    "ArgumentError": "errors",
    "SettingError": "errors",
    "RecordingError": "errors",
    "ModelError": "errors",
    "AccelerationError": "errors",
    "ConvergenceError": "errors",
    "SimulationError": "errors",
    "ExperimentError": "errors",
    "CampaignError": "errors",
}

__all__ = ["__version__"]
__all__ += _HOMES  # pyright: ignore[reportUnsupportedDunderAll] - __init__.pyi has them


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        # Python itself says which name is near, if there is one.
        raise AttributeError(f"flexid has no {name!r}", name=name, obj=import_module(__name__))
    value = getattr(import_module(f"{__name__}.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
