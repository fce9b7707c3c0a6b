"""Export to C99: an online estimator for a drive, with an example and a test vector."""

import hashlib
from math import exp
from pathlib import Path

import numpy as np

from flexid.arrays import FloatArray
from flexid.derivation.drive_source import MACROS, drive_functions
from flexid.errors import SettingError, SimulationError
from flexid.estimators.online import History, Status
from flexid.estimators.recursive_least_squares import recursive_least_squares
from flexid.estimators.samples import Samples
from flexid.exports.request import EstimatorSettings, ExportRequest, rendered
from flexid.models.parametric_system import Row

_LARGEST_SAMPLE = 1e9  # of a number in a sample, in its unit; beyond it is a sensor fault

_MOST_COEFFICIENTS = 31  # of a row: the bits of one number flag the determined ones

_RECENT = 10.0  # time constants of the filter that "recent" samples span


class DriveSource:
    """Header and source of an online estimator in C99."""

    def __init__(self, request: ExportRequest, settings: EstimatorSettings) -> None:
        self.system, self.settings = request.system, settings
        for row in self.system.rows:
            if len(row.coefficients) > _MOST_COEFFICIENTS:
                raise SettingError(
                    row.name,
                    f"has {len(row.coefficients)} coefficients, more than the {_MOST_COEFFICIENTS} "
                    f"of a row that an estimator in C takes: leave some out",
                )
        self.twin = recursive_least_squares(self.system, **vars(settings))
        self.values = request.values  # start values; 0 for coefficients left out
        self.functions = drive_functions(self.system)
        self._units = request.units
        # For the templates: C identifiers of states, inputs, coefficients; signals in a sample.
        self.names = self.functions.names
        self.sample_names = (*self.system.states[::2], *self.system.inputs)
        # Numbers of coefficients, index of the first one of each row, and start values.
        self.counts = [len(row.coefficients) for row in self.system.rows]
        self.row_starts = [0, *(part.stop for _, part in self.system.row_slices())]
        begun = self.twin.coefficients(self.twin.init(self.values)).tolist()
        self.start = dict(zip(self.system.coefficients, begun, strict=True))
        # Sample whose input is held until the next one; macros for functions of math.h.
        self.held_input = "state->latest" if self.settings.hold == "zero" else "latest"
        used = self.functions.calls | {"FABS", "SQRT"}
        self.calls = [name for name in MACROS if name in used]
        # Weight of the latest sample in the means over recent samples.
        self.recent_weight = 1.0 - exp(
            -self.settings.sample_time * self.settings.filter_rate / _RECENT
        )

    def unit(self, name: str) -> str:
        """Return the unit of a coefficient or of a signal, for a comment."""
        return self._units.get(name) or "in the model's unit"

    def equation(self, row: Row) -> str:
        """Return the right-hand side of a row, as in eq. (1)."""
        terms = [f"{name}*({text})" for name, text in row.regressors.items()]
        return " + ".join([*terms, *[row.known] * (row.known != "0")])

    def header(self) -> str:
        """Return the text of ``flexid_drive.h``."""
        parts = (self.source(), self.text("state.h").rstrip(), self.text("sizes.h").rstrip())
        decisive = "".join(parts)
        version = int.from_bytes(hashlib.sha256(decisive.encode()).digest()[:4])
        return self.text("drive.h", version=version, version_float=version ^ 0xFFFFFFFF)

    def source(self) -> str:
        """Return the text of ``flexid_drive.c``."""
        return self.text("drive.c")

    def text(self, name: str, **more: object) -> str:
        """Render a template for this estimator."""
        return rendered(
            f"c99/{name}",
            drive=self,
            settings=self.settings,
            law=self.twin.law,
            largest=_LARGEST_SAMPLE,
            **more,
        )


def write(
    request: ExportRequest,
    directory: Path,
    settings: EstimatorSettings,
    samples: Samples | None,  # log for the test vector
) -> tuple[str, ...]:
    """Write the files of an estimator."""
    drive = DriveSource(request, settings)
    vector = made_samples(drive) if samples is None else log_samples(drive, samples)
    texts = {
        "flexid_drive.h": drive.header(),
        "flexid_drive.c": drive.source(),
        "example_main.c": drive.text("example_main.c"),
        "test_vector.h": vector_text(drive, vector),
        "README.md": drive.text("README.md"),
    }
    for name, text in texts.items():
        (directory / name).write_text(text, encoding="utf-8")
    return ()


_CHECKS = 50
_AFTER_MEMORY = 1000  # samples
_SPAN = 40.0  # time constants of the filter
_MOST_SAMPLES = 50_000  # a file of a few megabytes
_TONES = 3
_ACCELERATION = 30.0  # rad/s^2, caused by the input alone
_SEED = 12
_ALLOWED_DOUBLE, _ALLOWED_FLOAT = 1e-11, 1e-4
_MARGIN = 1000.0  # times the effect of rounded samples. Rounding of sums and solutions was seen to
# have 70 times this effect, and 600 times in float with poor excitation.
_SHORTEST_LOG = 100  # samples


def made_samples(drive: DriveSource) -> FloatArray:
    """Return samples for an export without a log: the model's motion under sums of sines."""
    h, rate = drive.settings.sample_time, drive.settings.filter_rate
    n = min(int(np.ceil(_SPAN / (rate * h))) + _AFTER_MEMORY, _MOST_SAMPLES)
    time = h * np.arange(n, dtype=np.float64)
    rng = np.random.default_rng(_SEED)
    inputs, _ = _sines(time, rate, rng, len(drive.system.inputs))
    try:
        states, inputs = _motion(drive, inputs)
    except SimulationError:
        positions, velocities = _sines(time, rate, rng, len(drive.system.rows))
        return drive.twin.pack(Samples(positions, velocities, inputs, h))
    return drive.twin.pack(Samples(states[:, ::2], states[:, 1::2], inputs, h))


def _sines(
    time: FloatArray, rate: float, rng: np.random.Generator, channels: int
) -> tuple[FloatArray, FloatArray]:
    """Return sums of sines near a rate in 1/s, and their derivatives, shape (n, channels)."""
    rates = rng.uniform(0.1, 1.5, (channels, _TONES)) * rate
    angles = time[:, None, None] * rates + rng.uniform(0.0, 2.0 * np.pi, (channels, _TONES))
    return np.sin(angles).mean(axis=2), (rates * np.cos(angles)).mean(axis=2)


def _motion(drive: DriveSource, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return states and inputs of a run from rest; the inputs are scaled to move the drive."""
    from flexid.simulation.free_run import free_run

    system, settings = drive.system, drive.settings
    values = {name: drive.values.get(name, 1.0) for name in system.coefficients}
    rest = np.zeros(len(system.states))
    h = settings.sample_time
    step = np.ones_like(inputs[:2])
    change = free_run(system, values, rest, step, h) - free_run(system, values, rest, 0 * step, h)
    gain = float(np.abs(change[1, 1::2]).max()) / h
    scaled = inputs * (_ACCELERATION / gain if gain > 0.0 else 1.0)
    return free_run(system, values, rest, scaled, h, settings.hold), scaled


def log_samples(drive: DriveSource, samples: Samples) -> FloatArray:
    """Return the samples of a log in the estimator's format."""
    system = drive.system
    if len(samples) < _SHORTEST_LOG:
        raise SettingError(
            "log", f"has {len(samples)} samples without a gap: give one of {_SHORTEST_LOG} or more"
        )
    found = samples.positions.shape[1], samples.inputs.shape[1]
    if found != (len(system.rows), len(system.inputs)):
        raise SettingError(
            "log",
            f"has {found[0]} positions and {found[1]} inputs, but the model has "
            f"{len(system.rows)} and {len(system.inputs)}: give a log of this model's drive",
        )
    return drive.twin.pack(samples)


def vector_text(drive: DriveSource, samples: FloatArray) -> str:
    """Return the text of ``test_vector.h``: estimates at samples where they are determined."""

    def replay(samples: FloatArray) -> History:
        return drive.twin.replay(drive.twin.init(drive.values), samples)

    history = replay(samples)
    first, last = _first_check(drive, history), len(samples) - 1
    places = np.unique(np.linspace(first, last, _CHECKS).astype(int))
    estimates = history.coefficients[places]
    scale = np.abs(estimates).max(axis=0)
    scale[scale == 0.0] = 1.0

    def allowed(number: type[np.floating], least: float) -> list[float]:
        """Return the largest allowed relative differences, from samples that are rounded."""
        last_digit = np.finfo(number).eps * np.abs(samples).max(axis=0)
        signs = np.random.default_rng(_SEED).choice([-1.0, 1.0], samples.shape)
        found = replay(samples + signs * last_digit).coefficients[places]
        changes = (np.abs(found - estimates) / scale).max(axis=0)
        return np.maximum(least, _MARGIN * changes).tolist()

    return drive.text(
        "test_vector.h",
        samples=samples.tolist(),
        checks=[*zip(places.tolist(), estimates.tolist(), strict=True)],
        scale=scale.tolist(),
        least={"double": _ALLOWED_DOUBLE, "float": _ALLOWED_FLOAT},
        allowed={
            "double": allowed(np.float64, _ALLOWED_DOUBLE),
            "float": allowed(np.float32, _ALLOWED_FLOAT),
        },
    )


def _first_check(drive: DriveSource, history: History) -> int:
    """Return the first sample to compare, from which on estimates are determined."""
    # While the filter's initial state matters, there are more unknowns and rounding errors.
    n = len(history.status)
    open_ = np.flatnonzero(history.status != Status.USED)
    determined = int(open_[-1]) + 1 if len(open_) else 0
    settled = 2 * drive.twin.law.memory  # in samples: the filter's initial state has decayed
    return min(max(settled, determined if determined < n else 3 * n // 4), n - 1)
