"""Convert logs of others, as they publish them in MATLAB's format, to CSV files.

    python examples/real_logs/from_matlab.py ist-arm amp1_5data_squarewave06Hz.mat arm.csv
    python examples/real_logs/from_matlab.py kuka data.mat kr300.csv

`ist-arm` is the flexible arm of github.com/avdolrahman/Flexible-Robot-Arm- (MIT), `kuka` the KR300
of github.com/JonasWeigand/Robot_Identification (MIT). Names and units are those with which the
publishers' own scripts read the files: a scope of Simulink (`Input`), and a structure `rec` with
one row for each axis. What is printed tells whether it is the log that a page is about.
"""

import argparse
import hashlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

FloatArray = NDArray[np.float64]

KUKA_SAMPLE_TIME = 0.004  # s, as the publisher's scripts have it
KUKA_AXES = (1, 2, 3)  # those with an encoder on the link
KUKA_CHANNELS = {  # ours, and theirs
    "q_link_deg": "act_pos_se_deg",
    "qd_link_deg_s": "act_vel_se_deg_per_s",
    "q_mot_deg": "act_pos_mot_deg",
    "qd_mot_deg_s": "act_vel_mot_deg_per_s",
    "tau_mot_Nm": "act_torque_abs_nm",
}


def ist_arm(file: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Columns of the arm: motor voltage, potentiometer and strain gauge, all in V."""
    scope = part(file, "Input")
    signals = np.atleast_2d(numbers(part(part(scope, "signals"), "values")))
    names = ("u_V", "pot_V", "strain_V")
    if signals.shape[1] != len(names):
        sys.exit(f"Input.signals.values has {signals.shape[1]} columns instead of {len(names)}")
    return {"t_s": numbers(part(scope, "time")), **dict(zip(names, signals.T, strict=True))}


def kuka(file: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Columns of the three axes that have two encoders."""
    rec = part(file, "rec")
    channels = {
        name: np.atleast_2d(numbers(part(rec, theirs))) for name, theirs in KUKA_CHANNELS.items()
    }
    count = min(values.shape[1] for values in channels.values())
    columns = {"t_s": KUKA_SAMPLE_TIME * np.arange(count)}
    for axis in KUKA_AXES:
        for name, values in channels.items():
            columns[f"a{axis}_{name}"] = values[axis - 1, :count]
    return columns


def part(whole: Any, name: str) -> Any:
    """A variable of a file or a field of a structure; if it is not there, say what is."""
    if isinstance(whole, Mapping):
        known = [key for key in whole if not key.startswith("__")]
    else:
        known = list(getattr(getattr(whole, "dtype", None), "names", None) or ())
    if name not in known:
        sys.exit(f"there is no {name!r} in this file; found {', '.join(known) or 'no names'}")
    return whole[name] if isinstance(whole, Mapping) else whole[name].item()


def numbers(values: Any) -> FloatArray:
    """Values as numbers."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        return sys.exit("the file holds something else than numbers where the log should be")


def csv_text(columns: Mapping[str, FloatArray]) -> str:
    """Columns as CSV text with seven digits."""
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) != 1:
        sys.exit(f"the columns differ in length: {lengths}")
    rows = np.column_stack(list(columns.values()))
    lines = [",".join(columns), *(",".join(f"{cell:.7g}" for cell in row) for row in rows)]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Convert a file and print what came of it."""
    kinds = {"ist-arm": ist_arm, "kuka": kuka}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=kinds)
    parser.add_argument("matlab", type=Path)
    parser.add_argument("csv", type=Path)
    arguments = parser.parse_args()
    try:
        file = loadmat(arguments.matlab, squeeze_me=True)
    except NotImplementedError:  # what SciPy raises at version 7.3
        sys.exit(f"{arguments.matlab} is of version 7.3: load it in Octave and save it with -v7")
    except Exception as error:  # SciPy has no common root for what damaged files raise
        sys.exit(f"{arguments.matlab} cannot be read as a MATLAB file: {error}")
    columns = kinds[arguments.kind](file)
    text = csv_text(columns)
    arguments.csv.write_text(text, encoding="utf-8")
    time = columns["t_s"]
    print(
        f"{arguments.csv}: {len(time)} samples, every {1000 * np.median(np.diff(time)):.6g} ms, "
        f"SHA-256 {hashlib.sha256(text.encode()).hexdigest()[:16]}"
    )


if __name__ == "__main__":
    main()
