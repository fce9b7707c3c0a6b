"""Physical parameters of a joint from its lumped coefficients, and back.

Nearly every physical parameter is a product of powers of the coefficients, for example

    joint_stiffness ke = alpha1 / beta1,    link_inertia Jl = ke / theta2,

so that the map, its inverse and its derivative all follow from one table of exponents.
`Huang (2003)`, section 3, with the motor inertia 1/beta1 known; here beta1 may be unknown too.
Gravity that has a sine and a cosine is the exception: an amplitude and an angle.
"""

from collections.abc import Collection, Mapping

from flexid.models.parameter_kinds import (
    Amplitude,
    Directional,
    PhysicalParameter,
    Product,
    ZeroAngle,
)

_JOINT_STIFFNESS = {"alpha1": 1, "beta1": -1}
_LINK_INERTIA = {"alpha1": 1, "beta1": -1, "theta2": -1}
_INERTIA_RATIO = {"alpha1": 1, "theta2": -1}

_GRAVITY_ANGLE = ZeroAngle("gravity_angle", "rad", "theta1", "theta_cosine")

_SHAPE_RATIOS: tuple[PhysicalParameter, ...] = (
    Product("half_backlash", "rad", {"alpha_backlash": 1, "alpha1": -1}),
    Amplitude("eccentricity", "rad", "alpha_ecc_sine", "alpha_ecc_cosine", {"alpha1": -1}),
    ZeroAngle("eccentricity_angle", "rad", "alpha_ecc_sine", "alpha_ecc_cosine"),
)

_WITH_TORQUE: tuple[PhysicalParameter, ...] = (
    Product("gravity_torque", "N m", {"theta1": 1, **_LINK_INERTIA}),
    Amplitude("gravity_torque", "N m", "theta1", "theta_cosine", _LINK_INERTIA),
    _GRAVITY_ANGLE,
    Product("link_inertia", "kg m^2", _LINK_INERTIA),
    Product("joint_stiffness", "N m/rad", _JOINT_STIFFNESS),
    Product("motor_inertia", "kg m^2", {"beta1": -1}),
    Product("motor_viscous_friction", "N m s/rad", {"alpha2": 1, "beta1": -1}),
    Product("motor_coulomb_friction", "N m", {"alpha_coulomb": 1, "beta1": -1}),
    Product("motor_offset_torque", "N m", {"alpha_offset": 1, "beta1": -1}),
    Product("joint_damping", "N m s/rad", {"alpha_damping": 1, "beta1": -1}),
    Product("cubic_joint_stiffness", "N m/rad^3", {"alpha_cubic": 1, "beta1": -1}),
    Product("motor_stribeck_friction", "N m", {"alpha_stribeck": 1, "beta1": -1}),
    Product("motor_drag", "N m s^2/rad^2", {"alpha_drag": 1, "beta1": -1}),
    Product("torque_saturation", "1/(N m)^2", {"alpha_saturation": 1, "beta1": -1}),
    Product("spring_hysteresis", "N m", {"alpha_hysteresis": 1, "beta1": -1}),
    Product("hysteresis_reach", "rad", {"hysteresis_grip": -1}),
    Amplitude("torque_ripple", "N m", "alpha_ripple_sine", "alpha_ripple_cosine", {"beta1": -1}),
    ZeroAngle("ripple_angle", "rad", "alpha_ripple_sine", "alpha_ripple_cosine"),
    Product("bend_stiffness", "N m/rad", {"alpha_bend": 1, "beta1": -1}),
    Product("lopsided_stiffness", "N m/rad^2", {"alpha_lopsided": 1, "beta1": -1}),
    *_SHAPE_RATIOS,
    Product("link_drag", "N m s^2/rad^2", {"theta_drag": 1, **_LINK_INERTIA}),
    Product("link_viscous_friction", "N m s/rad", {"theta_viscous": 1, **_LINK_INERTIA}),
    Product("link_coulomb_friction", "N m", {"theta_coulomb": 1, **_LINK_INERTIA}),
    Product("link_offset_torque", "N m", {"theta_offset": 1, **_LINK_INERTIA}),
)
"""What the coefficients give when the input is a torque, so that beta1 = 1 / motor inertia."""

_RATIOS: tuple[PhysicalParameter, ...] = (
    Product("gravity_torque_per_link_inertia", "1/s^2", {"theta1": 1}),
    Amplitude("gravity_torque_per_link_inertia", "1/s^2", "theta1", "theta_cosine"),
    _GRAVITY_ANGLE,
    Product("joint_stiffness_per_link_inertia", "1/s^2", {"theta2": 1}),
    Product("joint_stiffness_per_motor_inertia", "1/s^2", {"alpha1": 1}),
    Product("link_inertia_per_motor_inertia", "1", _INERTIA_RATIO),
    Product("gravity_torque_per_motor_inertia", "1/s^2", {"theta1": 1, **_INERTIA_RATIO}),
    Amplitude(
        "gravity_torque_per_motor_inertia", "1/s^2", "theta1", "theta_cosine", _INERTIA_RATIO
    ),
    Product("viscous_friction_per_motor_inertia", "1/s", {"alpha2": 1}),
    Product("coulomb_friction_per_motor_inertia", "1/s^2", {"alpha_coulomb": 1}),
    Product("joint_damping_per_motor_inertia", "1/s", {"alpha_damping": 1}),
    *_SHAPE_RATIOS,
    Product("viscous_friction_per_link_inertia", "1/s", {"theta_viscous": 1}),
    Product("coulomb_friction_per_link_inertia", "1/s^2", {"theta_coulomb": 1}),
    Product("input_gain_per_motor_inertia", "rad/s^2/{input}", {"beta1": 1}),
)
"""What is left when the input is no torque: nothing absolute, only ratios."""


_LINK_RATIOS: tuple[PhysicalParameter, ...] = (
    Product("gravity_torque_per_link_inertia", "1/s^2", {"theta1": 1}),
    Amplitude("gravity_torque_per_link_inertia", "1/s^2", "theta1", "theta_cosine"),
    _GRAVITY_ANGLE,
    Product("joint_stiffness_per_link_inertia", "1/s^2", {"theta2": 1}),
    Product("viscous_friction_per_link_inertia", "1/s", {"theta_viscous": 1}),
    Product("coulomb_friction_per_link_inertia", "1/s^2", {"theta_coulomb": 1}),
    Product("joint_damping_per_link_inertia", "1/s", {"theta_damping": 1}),
    Product("cubic_joint_stiffness_per_link_inertia", "1/(rad^2 s^2)", {"theta_cubic": 1}),
    Product("bend_stiffness_per_link_inertia", "1/s^2", {"theta_bend": 1}),
    Product("offset_torque_per_link_inertia", "1/s^2", {"theta_offset": 1}),
    Product("half_backlash", "rad", {"theta_backlash": 1, "theta2": -1}),
    Amplitude("eccentricity", "rad", "theta_ecc_sine", "theta_ecc_cosine", {"theta2": -1}),
    ZeroAngle("eccentricity_angle", "rad", "theta_ecc_sine", "theta_ecc_cosine"),
)
"""What the link's row alone gives, which knows no torque."""


def _by_direction(suffix: str, units: tuple[str, str], **exponents: int) -> list[Directional]:
    """Friction forwards and backwards, where viscous friction differs between the directions.

    A constant force is then counted as Coulomb friction that differs, as which it acts.
    """
    directions = (("forwards", 1.0), ("backwards", -1.0))
    return [
        Directional(
            f"viscous_friction_{direction}{suffix}",
            units[0],
            "gamma_viscous",
            "gamma_asymmetry",
            exponents,
            sign,
        )
        for direction, sign in directions
    ] + [
        Directional(
            f"coulomb_friction_{direction}{suffix}",
            units[1],
            "gamma_coulomb",
            "gamma_offset",
            exponents,
            -sign,
            ("gamma_asymmetry",),
        )
        for direction, sign in directions
    ]


_RIGID_WITH_TORQUE: tuple[PhysicalParameter, ...] = (
    Product("gravity_torque", "N m", {"gamma1": 1, "beta1": -1}),
    Amplitude("gravity_torque", "N m", "gamma1", "gamma_cosine", {"beta1": -1}),
    ZeroAngle("gravity_angle", "rad", "gamma1", "gamma_cosine"),
    Product("inertia", "kg m^2", {"beta1": -1}),
    Product("viscous_friction", "N m s/rad", {"gamma_viscous": 1, "beta1": -1}),
    Product("coulomb_friction", "N m", {"gamma_coulomb": 1, "beta1": -1}),
    Product("offset_torque", "N m", {"gamma_offset": 1, "beta1": -1}),
    *_by_direction("", ("N m s/rad", "N m"), beta1=-1),
)

_RIGID_RATIOS: tuple[PhysicalParameter, ...] = (
    Product("gravity_torque_per_inertia", "1/s^2", {"gamma1": 1}),
    Amplitude("gravity_torque_per_inertia", "1/s^2", "gamma1", "gamma_cosine"),
    ZeroAngle("gravity_angle", "rad", "gamma1", "gamma_cosine"),
    Product("viscous_friction_per_inertia", "1/s", {"gamma_viscous": 1}),
    Product("coulomb_friction_per_inertia", "1/s^2", {"gamma_coulomb": 1}),
    Product("offset_torque_per_inertia", "1/s^2", {"gamma_offset": 1}),
    *_by_direction("_per_inertia", ("1/s", "1/s^2")),
    Product("input_gain_per_inertia", "rad/s^2/{input}", {"beta1": 1}),
)


PARAMETER_NAMES: tuple[str, ...] = tuple(
    dict.fromkeys(
        p.name
        for table in (_WITH_TORQUE, _RATIOS, _LINK_RATIOS, _RIGID_WITH_TORQUE, _RIGID_RATIOS)
        for p in table
    )
)
"""Names of all physical parameters, of whichever joint and input."""


def physical_parameters(
    coefficients: Collection[str], input_is_torque: bool
) -> tuple[PhysicalParameter, ...]:
    """Physical parameters of the flexible joint that a set of coefficients determines.

    If the input is no torque in N m, only ratios are known. With ``gravity_cosine`` among the
    terms, gravity is the amplitude of both its parts, and ``gravity_angle`` the link encoder's
    reading where the link hangs straight down.
    """
    return _determined(_WITH_TORQUE if input_is_torque else _RATIOS, coefficients)


def link_parameters(coefficients: Collection[str]) -> tuple[PhysicalParameter, ...]:
    """Physical parameters that the link's row alone determines; as `physical_parameters`.

    All are relative to the link's inertia, which no log without a torque shows.
    """
    return _determined(_LINK_RATIOS, coefficients)


def rigid_parameters(
    coefficients: Collection[str], input_is_torque: bool
) -> tuple[PhysicalParameter, ...]:
    """Physical parameters of the rigid joint; as `physical_parameters`.

    The inertia is that of motor and link together, at the link side of the gear.
    """
    return _determined(_RIGID_WITH_TORQUE if input_is_torque else _RIGID_RATIOS, coefficients)


def _determined(
    table: tuple[PhysicalParameter, ...], coefficients: Collection[str]
) -> tuple[PhysicalParameter, ...]:
    # Of two entries with one name the later one heeds more coefficients, and takes the place.
    found = {p.name: p for p in table if set(p.coefficients) <= set(coefficients)}
    return tuple(found.values())


_LINK = {
    "theta1": "gravity_torque",
    "theta2": "joint_stiffness",
    "theta_viscous": "link_viscous_friction",
    "theta_damping": "joint_damping",
    "theta_coulomb": "link_coulomb_friction",
    "theta_cubic": "cubic_joint_stiffness",
    "theta_offset": "link_offset_torque",
}
_MOTOR = {
    "alpha1": "joint_stiffness",
    "alpha2": "motor_viscous_friction",
    "alpha_damping": "joint_damping",
    "alpha_coulomb": "motor_coulomb_friction",
    "alpha_cubic": "cubic_joint_stiffness",
    "alpha_offset": "motor_offset_torque",
}
"""The parameter that, over its side's inertia, gives each coefficient."""

JOINT_PARAMETERS = tuple(
    dict.fromkeys(("link_inertia", "motor_inertia", *_LINK.values(), *_MOTOR.values()))
)
"""Names of the physical parameters that `joint_coefficients` heeds."""


def joint_coefficients(parameters: Mapping[str, float]) -> dict[str, float]:
    """Coefficients of a flexible joint from physical parameters, both inertias among them.

    >>> table1 = joint_coefficients(
    ...     {"gravity_torque": 5, "link_inertia": 1, "joint_stiffness": 100, "motor_inertia": 0.25}
    ... )
    >>> table1["theta1"], table1["alpha1"], table1["beta1"]
    (5.0, 400.0, 4.0)
    """  # Huang (2003), below eq. (4)
    link = {
        c: parameters[n] / parameters["link_inertia"] for c, n in _LINK.items() if n in parameters
    }
    motor = {
        c: parameters[n] / parameters["motor_inertia"] for c, n in _MOTOR.items() if n in parameters
    }
    return link | motor | {"beta1": 1 / parameters["motor_inertia"]}
