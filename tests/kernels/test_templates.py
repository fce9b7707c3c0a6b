"""The templates as Python: each runs uncompiled, and gives what it gives compiled."""

import ast
import sys
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest
from numba.core import config
from numba.core.ccallback import CFunc

from flexid.arrays import FloatArray
from flexid.control.laws import pd_gravity, robust_law
from flexid.control.loop import LoopDeclaration
from flexid.control.references import sinusoid
from flexid.derivation.closed_loop import compose_loop, lane_loop_source, stiff_loop_source
from flexid.derivation.model_functions import compiled_signals
from flexid.derivation.sampled_loop import sampled_loop_source
from flexid.derivation.sensitivities import sensitivity_functions
from flexid.estimators.channel_timing import Timing
from flexid.estimators.parametric_observer import parametric_observer
from flexid.estimators.recursive_least_squares import recursive_least_squares
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import By, Point, segmented_motion
from flexid.estimators.segments import divide
from flexid.kernels import store
from flexid.kernels.store import load_kernel
from flexid.models.flexible_joint import flexible_joint
from flexid.models.terms import with_dry_friction
from flexid.simulation.closed_loop import ClosedLoop, simulate
from flexid.simulation.ensemble import simulate_ensemble
from flexid.simulation.free_run import Command, free_run, play
from flexid.simulation.sampled import Sampling, simulate_sampled
from flexid.streaming.guard import Guard

FOLDER = Path(store.__file__).parent / "templates"
TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 300.0, "alpha2": 0.3}
JOINT = flexible_joint(known={"beta1": 3.0})
DRY = with_dry_friction(flexible_joint(("gravity", "motor_viscous", "motor_coulomb")))
H = 2e-3
TIME = H * np.arange(120)
TORQUE = 3.0 * np.sin(40.0 * TIME)
COMMAND = Command(TORQUE, np.outer(TIME, [0.1, 0.2]), np.array([5.0, 0.5]))


def loop(robust: bool = False) -> ClosedLoop:
    """Return a loop with the joint."""
    law = robust_law() if robust else pd_gravity()
    gains = {"link": 1.0, "motor": 1.0}
    return ClosedLoop(JOINT, TRUE, law, sinusoid(1.0, 2.0), gains)


def samples() -> Samples:
    """Return a short record of the joint."""
    states = free_run(JOINT, TRUE, np.zeros(4), TORQUE[:, None], H)
    return Samples(states[:, ::2].copy(), states[:, 1::2].copy(), TORQUE[:, None].copy(), H)


def estimate(estimator: Any) -> None:
    """Feed an online estimator all samples at once, and another one alone."""
    packed = estimator.pack(samples())
    packed[40] = np.nan  # is refused, and what follows begins again
    last = estimator.replay(estimator.init({"theta1": 4.0, "theta2": 80.0}), packed)
    estimator.step(last.state, packed[-1])


def watch_a_stream() -> None:
    """Guard samples with a fault of every kind in them."""
    record = samples()
    rows: FloatArray = np.column_stack((TIME, record.positions, record.inputs)).astype(np.float64)
    rows[30, 0] = np.nan
    rows[40, 1] = np.inf
    rows[50, 1] += 1.0
    rows[60:, 2] += 2.0 * np.pi
    rows[70, 0] = rows[69, 0]
    rows[75, 0] = rows[60, 0]
    rows[80:, 0] += 0.5
    rows[90:, 1] = rows[90, 1]
    guard = Guard(H, 2, 1, from_deflection=False, motor_turn=0.01)
    state = guard.first_state()
    while len(rows):
        guarded = guard.guard(state, rows)
        state, rows = guarded.state, rows[guarded.judged :]


def equations() -> None:
    """Put up the normal equations of a joint whose motor sticks, with a delay sought."""
    record = samples()
    timing = Timing("linear", {"input_delay": 1e-4}, ("input_delay",))
    problem = segmented_motion(DRY, divide([record], 0.1), timing)
    values = {**TRUE, "beta1": 3.0, "alpha_coulomb": 5.0}
    sought = [values[name] for name in problem.unknowns.names] + [1e-4]
    start = np.zeros((len(problem.segments), 4))
    for by in get_args(By):
        problem.equations(Point(np.array(sought), start), by)


ROOTS = ("sin_cos", "free_run", "sampled_loop", "rodas5p", "dopri5", "prediction_error", "model")
ROOTS += ("parametric_observer", "least_squares", "stream_guard")

CASES: dict[str, Callable[[], Any]] = {
    "free run": lambda: free_run(JOINT, TRUE, np.full(4, 0.1), TORQUE[:, None], H),
    "played run": lambda: play(JOINT, TRUE, np.zeros(4), COMMAND, H),
    "sampled loop": lambda: simulate_sampled(loop(), 0.1, Sampling(H, 5.0, 1e-4, 1e-4, 1e-2)),
    "stiff loop": lambda: simulate(loop(robust=True), 0.01),
    "loops side by side": lambda: simulate_ensemble([loop()], 0.02, stiff=False),
    "segments": equations,
    "observer": lambda: estimate(parametric_observer(JOINT, {"link": 1.0, "motor": 1.0}, H)),
    "recursive least squares": lambda: estimate(recursive_least_squares(JOINT, H)),
    "guard of a stream": watch_a_stream,
}


def uncompiled(
    kernel: ModuleType, models: dict[int, Callable[..., None]], monkeypatch: pytest.MonkeyPatch
) -> dict[str, Any]:
    """Return the functions of a kernel as plain Python, and note a model by its address."""
    path = Path(str(kernel.__file__))
    plain: dict[str, Any] = {"__name__": "plain"}
    with monkeypatch.context() as patch:
        patch.setattr(config, "DISABLE_JIT", True)
        patch.setattr("numba.cfunc", lambda *_, **__: addressed)
        exec(compile(path.read_text("utf-8"), str(path), "exec"), plain)
    plain["call"] = lambda address, *arguments: models[int(address)](*arguments)
    plain["part"] = lambda numbers, first, size: numbers[first : first + size]
    for name, value in vars(kernel).items():
        if isinstance(value, CFunc):
            models[int(value.address or 0)] = plain[name]
    return plain


def addressed(function: Any) -> Any:
    """Return the function, with an address that is none."""
    function.address = 0
    return function


def flat(values: Any) -> list[Any]:
    """Return all numbers and arrays of nested tuples."""
    return [v for value in values for v in flat(value)] if isinstance(values, tuple) else [values]


def twice(
    name: str, compiled: Callable[..., Any], plain: Callable[..., Any], called: list[str]
) -> Callable[..., Any]:
    """Call a function compiled and uncompiled, and compare all that it returns and fills."""

    def call(*arguments: Any) -> Any:
        called.append(name)
        copies = deepcopy(arguments)
        result = compiled(*arguments)
        with np.errstate(all="ignore"):
            expected = plain(*copies)
        found = flat((result, arguments))
        for ours, right in zip(found, flat((expected, copies)), strict=True):
            if ours is None or right is None:
                assert ours is right
                continue
            sizes = np.abs(np.ravel(right).astype(float))
            size = np.max(sizes[np.isfinite(sizes)], initial=0.0)
            # Compiled sums may be fused or in another order; the slack is for what cancels.
            np.testing.assert_allclose(ours, right, rtol=1e-9, atol=1e-9 * size, err_msg=name)
        return result

    return call


@pytest.mark.parametrize("case", CASES)
def test_uncompiled_is_compiled(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Assert that every function that is called gives the same in Python, from these templates."""
    called: list[str] = []
    loaded: dict[str, SimpleNamespace] = {}
    models: dict[int, Callable[..., None]] = {}

    def load(
        task: str, declarations: list[str], build: Any, templates: Any = ()
    ) -> SimpleNamespace:
        kernel = load_kernel(task, declarations, build, templates)
        if kernel.__name__ not in loaded:
            assert {*templates} <= {*ROOTS}
            plain = uncompiled(kernel, models, monkeypatch)
            both = SimpleNamespace(**vars(kernel))
            for name, value in vars(kernel).items():
                if hasattr(value, "py_func"):
                    setattr(both, name, twice(name, value, plain[name], called))
            loaded[kernel.__name__] = both
        return loaded[kernel.__name__]

    for module in list(sys.modules.values()):
        # The record itself comes from a free run, which is a case of its own.
        own = module.__name__ == __name__ or (
            module.__name__.endswith("free_run") and case not in {"free run", "played run"}
        )
        if getattr(module, "load_kernel", None) is load_kernel and not own:
            monkeypatch.setattr(module, "load_kernel", load)
    CASES[case]()
    assert called


def test_every_template_runs_uncompiled() -> None:
    """Assert that no template is left out above."""
    assert {path.stem for path in FOLDER.glob("*.py")} - {"__init__"} == {*store.with_needed(ROOTS)}


def test_stub_has_the_arguments_that_are_generated() -> None:
    """Assert that the types of generated functions are those of functions that exist."""
    declaration = LoopDeclaration(JOINT, pd_gravity(), sinusoid(1.0, 2.0))
    law = compose_loop(declaration)
    sources = [
        compiled_signals(JOINT),
        sensitivity_functions(JOINT, "Test"),
        sampled_loop_source(declaration),
        stiff_loop_source(law),
        lane_loop_source(law, 2),
    ]
    generated = {name: value for source in sources for name, value in signatures(source).items()}
    stub = signatures((FOLDER / "generated.pyi").read_text("utf-8"))
    assert stub.items() <= generated.items()


def signatures(source: str) -> dict[str, list[str]]:
    """Return the arguments of each function of a source, by the function's name."""
    functions = [node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)]
    return {f.name: [argument.arg for argument in f.args.args] for f in functions}
