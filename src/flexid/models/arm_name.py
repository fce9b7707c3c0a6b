"""How the file of an arm is told from the models of one joint; apart, since all commands ask."""


def is_arm_file(model: str) -> bool:
    """Whether the word after ``--model`` is the path of a TOML file."""
    return model.lower().endswith(".toml")
