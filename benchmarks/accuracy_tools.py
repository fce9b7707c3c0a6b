"""Compared tools, with their numbers of logs and notes for the reader."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

_FOLDER = Path(__file__).with_name("peers")


@dataclass(frozen=True)
class Tool:
    """One tool of the comparison.

    Parameters
    ----------
    key : str
        Name in `accuracy.json` and on the command line.
    title : str
        Name in tables.
    module : str
        Module in `benchmarks/peers`.
    package : str
        Package that must be installed.
    seeds : int
        Number of logs of each kind.
    given : str
        Values that the user gives in addition to log and model.
    slow : bool
        Whether it is too slow for a warm-up run.
    arguments : mapping
        Further arguments of its `identify`.
    """

    key: str
    title: str
    module: str
    package: str
    seeds: int
    given: str
    slow: bool = False
    arguments: Mapping[str, float] = field(default_factory=dict)

    @property
    def source(self) -> Path:
        """File with the user's code."""
        return _FOLDER / f"{self.module}.py"


TOOLS = (
    Tool("flexid_identify", "flexid identify", "flexid_identify", "flexid", 5, "nothing"),
    Tool(
        "flexid_1s",
        "flexid prediction_error, 1 s",
        "flexid_prediction_error",
        "flexid",
        20,
        "hold; segments of 1 s",
    ),
    Tool(
        "flexid_10s",
        "flexid prediction_error, 10 s",
        "flexid_prediction_error",
        "flexid",
        20,
        "hold; segments of 10 s",
        arguments={"segment_duration": 10.0},
    ),
    Tool(
        "numpy",
        "NumPy least squares",
        "numpy_least_squares",
        "numpy",
        20,
        "hold; filter rate",
    ),
    Tool(
        "pysindy",
        "PySINDy, weak form",
        "pysindy_weak",
        "pysindy",
        5,
        "hold; windows and threshold tuned on other seeds",
    ),
    Tool(
        "filterpy",
        "filterpy EKF",
        "filterpy_ekf",
        "filterpy",
        5,
        "hold; sensors' noise; start at half the truth; process noise tuned",
    ),
    Tool(
        "casadi",
        "CasADi multiple shooting",
        "casadi_shooting",
        "casadi",
        1,
        "hold; sensors' noise; start at half the truth",
        slow=True,
    ),
    Tool(
        "mujoco",
        "MuJoCo sysid",
        "mujoco_sysid",
        "mujoco",
        1,
        "hold; start at half the truth; lengths of sequences tuned",
        slow=True,
    ),
)
