"""``flexid identify``: a joint, or with the file of an arm after ``--model`` an arm."""

from dataclasses import replace
from pathlib import Path

from flexid.cli.generated import Command, Options, present, show
from flexid.errors import SettingError
from flexid.models.arm_name import is_arm_file

_OF_AN_ARM = ("logs", "model", "columns")


def identify(command: Command, options: Options, flags: Options) -> None:
    """Identify a joint or an arm, and hand the answer over."""
    model = options.get("model", "")
    if not is_arm_file(model):
        present(command, options, flags)
        return
    given = [name for name in options if name not in _OF_AN_ARM]
    if given or flags["explain"]:
        name = (given or ["explain"])[0].replace("_", "-")
        raise SettingError(name, "is for one joint, and --model names an arm: leave it out")
    logs = options["logs"]
    if len(logs) > 1:
        raise SettingError("LOG", f"an arm takes one log, and {len(logs)} were given: give one")
    from flexid.library.arm_estimate import identify_arm

    show(
        replace(command, more="--json"),
        flags,
        lambda progress: identify_arm(logs[0], Path(model), options.get("columns"), progress),
    )
