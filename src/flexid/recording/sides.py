"""Sides of the joint to which positions and velocities belong whose names do not state one."""

from collections.abc import Collection, Iterable, Mapping, Set

from flexid.recording.names import quoted, split_header, words_of
from flexid.recording.recipes import Recipe
from flexid.recording.recording import POSITIONS, VELOCITIES
from flexid.recording.units import quantity_of

_YIELDING = {"pwm", "scale"}  # words of names that yield to a plain one


def name_sides(found: dict[str, list[Recipe]], given: Collection[str]) -> list[str]:
    """Assign quantities without a side to channels in `found`; return channels that are guesses.

    Channels in `given` have columns already.
    """
    guessed = _assign_pairs(found, given)
    found |= {name: _plainest(own) for name, own in found.items()}
    known = {*given, *found}
    places = known & {*POSITIONS}
    side = _side_of_bare(places, len(found.get("position", ())))
    for quantity in ("position", "velocity", "torque"):
        bare = found.get(quantity, [])
        own = side
        if quantity == "velocity" and not places and "position" not in found:
            speeds = {name.replace("velocity", "position") for name in known & {*VELOCITIES}}
            own = _side_of_bare(speeds, len(bare))
        name = f"{own}_{quantity}"
        # If positions are known, a bare torque may be the spring's.
        is_springs = quantity == "torque" and places
        if own and bare and name not in known and not is_springs:
            found[name] = bare
            guessed += [name] if own == "motor" or not _is_behind(bare[0]) else []
    return guessed


def stated_guess(
    guessed: Iterable[str], added: Mapping[str, Recipe], channels: Collection[str]
) -> str:
    """Return the part of a warning that names the guessed sides of added channels, or ""."""
    if {"link_position", "link_velocity"}.isdisjoint(channels):
        return ""  # of one encoder, the side is no guess
    guesses = [
        f"{added[name].header!r} is the {name.partition('_')[0]}'s"
        for name in guessed
        if name in added
    ]
    return f"that {' and '.join(guesses)} is a guess: " if guesses else ""


def several(name: str, headers: list[str], *, is_guess: bool) -> str:
    """Return the reason for refusing several columns of one channel, whose side may be a guess."""
    which = f"{quoted(headers)} could each be {name}"
    if is_guess and name == "motor_position" and len(headers) == 2:
        motor, link = map(repr, headers)
        return (
            f"{which}: assign both in a column map, as motor_position = {motor} and link_position "
            f"= {link}, or the other way round"
        )
    return f"{which}: rename the one that is, or assign it in a column map"


def likely_deflection(unused: Iterable[str], headers: Iterable[str]) -> str:
    """Return the unused column that may be a deflection: alpha, in a log that also has theta.

    In Quanser's logs of a flexible joint, theta is the motor's angle and alpha the deflection. In
    those of a pendulum, alpha is an angle without a spring.
    """
    if not any(_is_angle(header, "theta") for header in headers):
        return ""
    return next((header for header in unused if _is_angle(header, "alpha")), "")


def _is_angle(header: str, letter: str) -> bool:
    """Whether a name is a letter alone, in the unit of an angle."""
    bare, unit = split_header(header)
    words = words_of(bare)
    is_angle = unit is None or quantity_of(unit) == "position"
    return words is not None and words.all == (letter,) and is_angle


def drop_copies(filtered: dict[str, list[Recipe]], measured: Collection[str]) -> None:
    """Drop filtered columns that may be copies of a measured side, since they name no side."""
    for name in ("position", "velocity"):
        if name in filtered and {f"motor_{name}", f"link_{name}"} & {*measured}:
            sided = [one for one in filtered.pop(name) if _names_side(one.header)]
            filtered |= {name: sided} if sided else {}


def _assign_pairs(found: dict[str, list[Recipe]], given: Collection[str]) -> list[str]:
    """Assign two positions, or two velocities, of which one name is nearer to the motor."""
    guessed = []
    for quantity in ("position", "velocity"):
        pair = found.get(quantity, [])
        sided = {f"motor_{quantity}", f"link_{quantity}", "deflection"}
        if len(pair) != 2 or sided & {*found, *given}:
            continue
        motors, links = _by_nearness(pair)
        if len(motors) == 1:
            del found[quantity]
            found |= {f"motor_{quantity}": motors, f"link_{quantity}": links}
            guessed += [f"motor_{quantity}"]
            guessed += [] if _is_behind(links[0]) else [f"link_{quantity}"]
    return guessed


def _by_nearness(pair: list[Recipe]) -> tuple[list[Recipe], list[Recipe]]:
    """Columns of the motor's side and of the link's: a capstan is nearer to it than a joint is.

    By the convention of the literature, theta is the motor's and q is the link's.
    """
    words = [words_of(split_header(one.header)[0]) for one in pair]
    letters = [each.all if each is not None else () for each in words]
    if sorted(letters) == [("q",), ("theta",)]:
        are_near = [each == ("theta",) for each in letters]
    else:
        are_near = [each is not None and "transmission" in each.sides for each in words]
    near = [one for one, is_near in zip(pair, are_near, strict=True) if is_near]
    return near, [one for one in pair if one not in near]


def _plainest(columns: list[Recipe]) -> list[Recipe]:
    """Columns with a plain name; all if none has one."""
    words = [words_of(split_header(one.header)[0]) for one in columns]
    are_plain = [each is None or _YIELDING.isdisjoint(each.all) for each in words]
    return [one for one, is_plain in zip(columns, are_plain, strict=True) if is_plain] or columns


def _is_behind(column: Recipe) -> bool:
    """Whether a name is that of a part behind the spring, if the other side is the motor's."""
    words = words_of(split_header(column.header)[0])
    return words is not None and "joint" in words.sides


def _names_side(header: str) -> bool:
    """Whether a name has a word for a side of the joint, if only for a joint or a capstan."""
    words = words_of(split_header(header)[0])
    return words is not None and bool(words.sides)


def _side_of_bare(known: Set[str], count: int) -> str:
    """Side of the joint for positions whose names state none; "" if it is ambiguous."""
    if not known:
        return "motor"  # a drive with one encoder
    if count == 1 and known == {"motor_position"}:
        return "link"  # such as q in a log with theta_m
    return "motor" if count == 1 and known <= {"link_position", "deflection"} else ""
