"""What the parts of an arm's stored estimate must have in common, which no type says."""

from collections.abc import Iterator
from math import isfinite

from flexid.arms.result import ArmIdentification
from flexid.estimators.channel_timing import INPUT
from flexid.models.arm_file import MOST_JOINTS
from flexid.models.planar_arm import planar_arm
from flexid.stored_estimates.consistency import fit_complaints
from flexid.toml_file import Refuse


def check_arm(found: ArmIdentification, refuse: Refuse) -> None:
    """Refuse an arm whose parts contradict each other, by the key that is wrong."""
    for key, reason in _complaints(found):
        raise refuse(key, f"is wrong, {reason}: correct it")


def _complaints(found: ArmIdentification) -> Iterator[tuple[str, str]]:
    arm = found.arm
    if not 1 <= arm.joints <= MOST_JOINTS:
        yield "arm.lengths", f"an arm has 1 to {MOST_JOINTS} joints"
        return
    if not all(map(isfinite, (*arm.lengths, *arm.gravity))):
        yield "arm", "lengths and gravity must be numbers"
    if len(found.input_units) != arm.joints:
        yield "input_units", f"it must have one entry for each of {arm.joints} joints"
    values = {name: p.value for name, p in found.parameters.items()}
    yield from fit_complaints(found.fit, {f"parameters.{n}.value": v for n, v in values.items()})
    known = {*planar_arm(arm).coefficients}
    there = {*found.fit.names, *found.fixed} - {INPUT}
    if there != known:
        yield "fit.names", f"with 'fixed' it must name {min(there ^ known)!r} as the arm does"
    for name, value in found.fit.by_name.items():
        if name in values and values[name] != value:
            yield f"parameters.{name}.value", f"{values[name]:g} is not the fit's {value:g}"
    for name in values.keys() - known:
        if not name.startswith("stiffness_over_inertia_"):
            yield f"parameters.{name}", "it is no parameter of this arm"
