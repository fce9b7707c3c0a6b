"""Options that hold several values: names after commas, and name=number."""

from collections.abc import Iterable

from flexid.errors import SettingError


def parse_names(text: str) -> tuple[str, ...]:
    """Names that stand between commas."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def parse_known(assignments: Iterable[str]) -> dict[str, float]:
    """Values by name.

    Raises
    ------
    SettingError
        If one is no name=number.
    """
    known = {}
    for assignment in assignments:
        name, _, text = assignment.partition("=")
        try:
            known[name.strip()] = float(text)
        except ValueError:
            raise SettingError(
                "--known", f"{assignment!r} is no name=number, e.g. motor_inertia=0.3"
            ) from None
    return known
