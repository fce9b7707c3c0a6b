"""The torque balance of a planar arm: accelerations, derivatives, dry friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from benchmarks.arms.arm import mjcf, random_arm
from two_links import ARM, TRUTH, TwoLinks, motion

from flexid.arms.disturbed import as_physical
from flexid.arms.doubts import other_falls, rig_errors, zeros
from flexid.arms.identify import carried_inertia
from flexid.arrays import FloatArray
from flexid.derivation.torque_balance import balance_functions
from flexid.estimators.channel_timing import Timing
from flexid.estimators.samples import Samples, divide
from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.identification.preparation.joint import ElasticArm
from flexid.kernels.store import template
from flexid.models.motion import JointType
from flexid.models.planar_arm import PlanarArm, planar_arm
from flexid.models.torque_balance import BodyTerm

BALANCE = planar_arm(ARM)
STRIBECK = 0.3  # N m, of motor 1 at rest
HELD = 25  # samples


def rates(
    functions: dict[str, Any], x: FloatArray, u: FloatArray, p: FloatArray, arm: PlanarArm = ARM
) -> FloatArray:
    """Return the rates of the states, with all rows sliding."""
    found = np.empty(len(x))
    constants = np.array(list(planar_arm(arm).constants.values()))
    modes, no_blocks = np.where(x[1::2] < 0.0, -1.0, 1.0), np.zeros(0)
    functions["state_rates"](x, u, modes, p, constants, no_blocks, found)
    return found


@cache
def functions_of(types: tuple[JointType, ...]) -> dict[str, Any]:
    """Return the generated functions of an arm as plain Python, cached by types of joints."""
    balance = planar_arm(arm_of(types))
    names: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("numba.njit", lambda **_: lambda function: function)
        source = template("compiled") + balance_functions(balance)
        exec(compile(source, "generated", "exec"), names)
    return names


def arm_of(types: Sequence[JointType], gravity: tuple[float, float] = (0.0, 0.0)) -> PlanarArm:
    """Return an arm with slides in random directions."""
    angles = np.random.default_rng(5).uniform(-2.0, 2.0, len(types))
    ways = zip(types, angles.tolist(), strict=True)
    slides = tuple(None if joint_type == "revolute" else angle for joint_type, angle in ways)
    return PlanarArm((0.4, 0.3, 0.2)[: len(types)], gravity, slides=slides)


def problem_of(torques: FloatArray, h: float, outputs: FloatArray | None = None) -> SegmentedMotion:
    """Return one segment of all samples; all parameters but the torque constants are unknown."""
    positions = np.zeros((len(torques), 4)) if outputs is None else outputs
    segments = divide([Samples(positions, None, torques, h)], 1e3)
    fixed = {"torque_constant_1": 1.0, "torque_constant_2": 1.0}
    arm = ElasticArm(BALANCE)
    problem = arm.motion(segments, Timing("zero"), arm.unknowns((), fixed))
    return replace(problem, substeps=4)


def sought(problem: SegmentedMotion) -> FloatArray:
    """Return the true values of the unknowns, and Stribeck friction."""
    values = {**TRUTH, "motor_stribeck_friction_1": STRIBECK}
    return np.array([values.get(name, 0.0) for name in problem.names])


# Types of joints by letter (P slides); some rotors move with the links.
SLIDING = [(34, "RPR"), (53, "PRP"), (27, "PPR"), (3, "RRP")]


@pytest.mark.parametrize(
    ("seed", "slides"),
    [
        *((seed, "") for seed in (0, 3, 6)),
        *(pytest.param(*each, marks=pytest.mark.thorough) for each in SLIDING),  # 5 s each
    ],
)
def test_accelerations_of_mujoco(seed: int, slides: str):
    """Assert that random arms, with rotors on base or links, accelerate as in MuJoCo."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, max(len(slides), 2), slides=bool(slides))
    known, n = arm.known, arm.joints
    assert not slides or [way[0].upper() for way in known.types] == [*slides]
    functions = functions_of(known.types)
    truth = {**arm.truth(), **{f"torque_constant_{i + 1}": 1.0 for i in range(n)}}
    for name in truth:  # MuJoCo's dry friction is smooth
        if "coulomb" in name:
            truth[name] = 0.0
    p = np.array([truth[name] for name in planar_arm(known).coefficients])
    model = mujoco.MjModel.from_xml_string(mjcf(arm, 1e-4))
    model.dof_frictionloss[:] = 0.0
    data = mujoco.MjData(model)
    places = {s: [model.joint(f"{s}_{i}").id for i in range(1, n + 1)] for s in ("link", "motor")}
    for _ in range(5):
        x, u = rng.normal(size=4 * n), rng.normal(size=n)
        shift = np.array([x[2::4], x[3::4]]) * arm.spun
        data.qpos[places["link"]] = x[::4] - shift[0]
        data.qvel[places["link"]] = x[1::4] - shift[1]
        data.qpos[places["motor"]], data.qvel[places["motor"]] = x[2::4], x[3::4]
        data.qfrc_applied[places["motor"]] = u
        mujoco.mj_forward(model, data)
        found = rates(functions, x, u, p, known)
        link = data.qacc[places["link"]] + data.qacc[places["motor"]] * arm.spun
        np.testing.assert_allclose(found[1::4], link, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(found[3::4], data.qacc[places["motor"]], rtol=1e-6, atol=1e-8)


TYPES: dict[str, JointType] = {"R": "revolute", "P": "prismatic"}


@pytest.mark.parametrize("letters", ["RR", "RP", "PR", "PP", "RPR"])
@pytest.mark.parametrize("gravity", [(0.0, 0.0), (3.0, -9.0)])
def test_parameters_of_the_links_are_a_base(letters: str, gravity: tuple[float, float]):
    """Assert that link parameters are independent, except the first moments without gravity."""
    types: list[JointType] = [TYPES[letter] for letter in letters]
    rng, n, balance = np.random.default_rng(5), len(types), planar_arm(arm_of(types, gravity))
    x, u, a = (rng.normal(size=(100, width)) for width in (4 * n, n, 2 * n))
    columns = np.zeros((100, 2 * n, len(balance.coefficients)))
    constants = np.array(list(balance.constants.values()))
    functions_of(balance.types)["columns"](x, u, np.sign(x[:, 1::2]), constants, a, columns)
    links = [k for k, (_, _, term) in enumerate(balance.placed()) if isinstance(term, BodyTerm)]
    own = columns.reshape(-1, len(balance.coefficients))[:, links]
    sizes = np.linalg.norm(own, axis=0)
    unfelt = {balance.coefficients[links[k]] for k in np.flatnonzero(sizes == 0.0)}
    moments = {"link_moment_along_1", "link_moment_across_1"}
    assert unfelt == (moments if letters[0] == "R" and not any(gravity) else set())
    shown = own[:, sizes > 0.0] / sizes[sizes > 0.0]
    assert np.linalg.matrix_rank(shown, tol=1e-4) == shown.shape[1]


@pytest.mark.parametrize("letters", ["RR", "RP", "PR", "PP", "RPR"])
def test_what_a_joint_carries_is_its_entry_of_the_mass_matrix(letters: str):
    """Assert the weights of inertias, masses and moments for the straight arm."""
    types: list[JointType] = [TYPES[letter] for letter in letters]
    arm = arm_of(types)
    balance, n = planar_arm(arm), arm.joints
    constants = np.array(list(balance.constants.values()))
    functions = functions_of(balance.types)
    for joint in range(1, n + 1):
        columns = np.zeros((2 * n, len(balance.coefficients)))
        accelerated = np.eye(2 * n)[2 * joint - 2]
        still = np.zeros(4 * n), np.zeros(n), np.zeros(2 * n)
        functions["columns_at"](*still, constants, accelerated, columns)
        links = [k for k, (_, _, term) in enumerate(balance.placed()) if isinstance(term, BodyTerm)]
        entry = {balance.coefficients[k]: columns[2 * joint - 2, k] for k in links}
        wanted = {name: weight for name, weight in entry.items() if abs(weight) > 1e-12}
        assert carried_inertia(arm, joint) == pytest.approx(wanted)


@pytest.mark.parametrize("letters", ["RR", "RPR"])
def test_a_physical_start_moves_a_stiff_joint_as_before(letters: str):
    """Assert that friction and a negative coupling of a stiff last joint move to other links."""
    types: list[JointType] = [TYPES[letter] for letter in letters]
    balance, n = planar_arm(arm_of(types, (9.81, 0.0))), len(types)
    values = {name: 0.0 if "friction" in name else 1.0 for name in balance.coefficients}
    values |= {f"link_viscous_friction_{n}": 0.3, f"motor_coulomb_friction_{n}": 0.2}
    moved = as_physical(balance, values | {f"rotor_coupling_{n}": -0.3, f"joint_damping_{n}": -0.2})
    assert moved[f"rotor_coupling_{n}"] == moved[f"joint_damping_{n}"] == 0.0
    assert moved[f"link_viscous_friction_{n}"] == 0.0
    values[f"rotor_coupling_{n}"] = -0.3
    rng = np.random.default_rng(2)
    x, u, a = (rng.normal(size=(20, size)) for size in (4 * n, n, 2 * n))
    x[:, -2:], a[:, -1] = x[:, -4:-2], a[:, -2]  # the last motor moves as its link
    columns = np.zeros((20, 2 * n, len(balance.coefficients)))
    constants = np.array(list(balance.constants.values()))
    functions_of(balance.types)["columns"](x, u, np.sign(x[:, 1::2]), constants, a, columns)
    before, after = (columns @ np.array([*own.values()]) for own in (values, moved))
    np.testing.assert_allclose(after[:, :-2], before[:, :-2], atol=1e-9)
    np.testing.assert_allclose(after[:, -2:].sum(axis=1), before[:, -2:].sum(axis=1), atol=1e-9)


def test_errors_of_a_rig_with_a_slide():
    """Assert that a slide has an error of direction and length, but no eccentric encoder."""
    arm = ElasticArm(planar_arm(PlanarArm((0.4, 0.3), slides=(None, 0.6))))
    segments = divide([Samples(np.ones((50, 4)), None, np.zeros((50, 2)), 2e-3)], 0.1)
    problem = arm.motion(segments, Timing("zero"), arm.unknowns((), {}))
    structure = SimpleNamespace(joint=arm)
    fitted: Any = SimpleNamespace(problem=problem, structure=structure, names=problem.names)
    rigs = [*rig_errors(fitted, ()), *other_falls(fitted), *zeros(fitted)]
    names = [*arm.balance.constants]
    changed = [
        [name for name, x, y in zip(names, rig.constants, problem.constants, strict=True) if x != y]
        for rig in rigs
    ]
    falls = [["stribeck_velocity_1"], ["stribeck_velocity_2"]]
    # First a sine, a cosine and two scales; the zero of a slide is no direction.
    assert changed == [[], [], [], [], ["l1"], ["d2"], *falls]


def held_torques(rng: np.random.Generator, count: int) -> FloatArray:
    """Return piecewise constant torques, so that joints stick and slip."""
    jumps = rng.normal(size=(count // HELD + 1, 2)) * [6.0, 1.5]
    return np.repeat(jumps, HELD, axis=0)[:count]


def test_stick_and_slip_of_an_independent_integrator():
    """Assert that coupled joints stick and slip as with SciPy's integrator and events.

    The friction of one motor falls off its static value.
    """
    rng = np.random.default_rng(3)
    h, torques = 2e-3, held_torques(rng, 400)
    start = np.array([0.3, 0.0, 0.3, 0.0, -0.2, 0.0, -0.2, 0.0])
    expected, changes = start[None], 0
    for held in torques[::HELD]:
        states, ended = motion(
            TwoLinks(held, stribeck=STRIBECK), h * np.arange(HELD + 1), expected[-1]
        )
        expected, changes = np.vstack((expected, states[1:])), changes + ended
    problem = problem_of(torques, h)
    found = -problem.equations(Point(sought(problem), start[None]), "nothing").residuals
    assert changes > 20
    assert np.ptp(expected[:, 0]) > 0.2
    np.testing.assert_allclose(found, expected[: len(found), ::2], atol=2e-6)


def test_sensitivities_by_finite_differences():
    """Assert derivatives by all parameters and initial states, also while sticking."""
    rng = np.random.default_rng(4)
    h, torques = 2e-3, held_torques(rng, 200)
    start = np.array([0.3, 0.5, 0.28, 0.4, -0.2, -0.6, -0.25, -0.5])
    outputs = rng.normal(size=(200, 4))
    problem = problem_of(torques, h, outputs)
    values = sought(problem)
    equations = problem.equations(Point(values, start[None]))
    everything = np.concatenate((start, values))
    for place in range(len(everything)):
        step = 1e-6 * max(abs(everything[place]), 0.1)
        both = []
        for sign in (1.0, -1.0):
            moved = everything.copy()
            moved[place] += sign * step
            point = Point(moved[8:], moved[None, :8])
            both.append(problem.equations(point, "nothing").residuals)
        slopes = (both[1] - both[0]) / (2.0 * step)
        gradient = float(np.sum(slopes * equations.residuals))
        size = np.sqrt(np.sum(slopes**2) * np.sum(equations.residuals**2))
        assert abs(gradient - equations.gradient[:, place].sum()) < 1e-4 * size + 1e-9, place
