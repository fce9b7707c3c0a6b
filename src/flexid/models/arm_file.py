"""How the word after ``--model`` says that it is an arm."""

from flexid.errors import SettingError


def is_arm_file(model: str) -> bool:
    """Whether it is the path of a TOML file, which is that of an arm."""
    return model.lower().endswith(".toml")


def refuse_arm_file(model: str) -> None:
    """Raise a `SettingError` for an arm where the model of one joint is wanted."""
    if is_arm_file(model):
        raise SettingError(
            "model", f"{model!r} is an arm: only flexid identify, the command, takes it"
        )
