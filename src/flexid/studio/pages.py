"""The studio's page and its parts. Whatever stands in a log or a name is escaped."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from math import log10
from typing import TYPE_CHECKING, Any

from flexid.report.page.page import drawing_style, page_environment

if TYPE_CHECKING:
    from jinja2 import Environment

_ASSETS = {"studio.css": "text/css", "studio.js": "text/javascript"}


@cache
def _environment() -> Environment:
    from jinja2 import PackageLoader

    environment = page_environment(PackageLoader("flexid.studio", "page"))
    environment.filters["log10"] = log10
    return environment


def fragment(template: str, **content: Any) -> str:
    """A part of the page as HTML."""
    return _environment().get_template(template).render(content)


@cache
def assets() -> dict[str, tuple[bytes, str]]:
    """Scripts and style sheets by name, with their types."""
    page = files("flexid.studio") / "page"
    own = {name: ((page / name).read_bytes(), kind) for name, kind in _ASSETS.items()}
    return {**own, "chart.css": (drawing_style().encode(), "text/css")}
