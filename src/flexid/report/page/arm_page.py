"""The page of an arm: its joints, whether to trust them, and how to repeat it."""

from collections.abc import Iterable
from pathlib import Path

from rich.text import Text

from flexid.arms.result import ArmIdentification
from flexid.report.arm_table import free_run_table, joint_table, reasons, timing_lines
from flexid.report.page.layout import Answer, Command, Page, Section, Warned


def arm_page(result: ArmIdentification, command: str) -> Page:
    """What there is to say of an arm."""
    joints = range(1, result.arm.joints + 1)
    sections = [Section("warnings", "Warnings", [*map(Warned, result.warnings)])]
    sections += [
        Section(
            f"joint-{joint}",
            f"Joint {joint}",
            [joint_table(result, joint), *reasons(result.of_joint(joint))],
        )
        for joint in joints[1:]
    ]
    sections += [
        Section(
            "prediction",
            "Prediction",
            [free_run_table(result), *map(Text, timing_lines(result))],
        ),
        Section("origin", "How to repeat it", [Command(command)]),
    ]
    logs = [Path(log["file"]).name for log in result.provenance["inputs"]]
    return Page(
        "identification",
        f"Planar arm of {result.arm.joints} joint{'s' if len(joints) > 1 else ''}",
        ", ".join(logs),
        joint_table(result, 1),
        (_trust(result, joints),),
        [section for section in sections if section.content],
    )


def _trust(result: ArmIdentification, joints: Iterable[int]) -> Answer:
    lacking = [p.name for p in result.parameters.values() if p.verdict != "determined"]
    word = "Not all of them" if lacking else "Yes"
    said = [Text(f"Not determined or weak: {', '.join(lacking)}.")] if lacking else []
    for joint in joints:
        share = result.free_run.get(f"deflection_{joint}")
        if share is not None:
            said.append(Text(f"A free run explains {share:.1f} % of deflection {joint}."))
    return Answer("Can these numbers be trusted?", word, "fair" if lacking else "good", said)
