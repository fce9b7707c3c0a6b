"""Templates of C and text with their placeholders filled."""

from functools import cache
from importlib import resources
from string import Template


@cache
def template_text(name: str) -> str:
    """Text of a template, such as ``"c99/drive.h"``."""
    return resources.files("flexid.exports").joinpath("templates", name).read_text("utf-8")


def filled(name: str, **values: str) -> str:
    """A template with its placeholders filled."""
    return Template(template_text(name)).substitute(values)
