"""The studio's page and its parts. Whatever stands in a log or a name is escaped."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from math import log10
from typing import TYPE_CHECKING, Any

from flexid.report.page.render import add_items

if TYPE_CHECKING:
    from jinja2 import Environment

_ASSETS = {"studio.css": "text/css", "studio.js": "text/javascript"}


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("flexid.studio", "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(log10=log10)
    add_items(environment)
    return environment


def fragment(template: str, **content: Any) -> str:
    """A part of the page as HTML."""
    return _environment().get_template(template).render(content)


@cache
def assets() -> dict[str, tuple[bytes, str]]:
    """Scripts and style sheets by name, with their types."""
    from flexid.report.page.render import drawing_style

    page = files("flexid.studio") / "page"
    own = {name: ((page / name).read_bytes(), kind) for name, kind in _ASSETS.items()}
    return {**own, "chart.css": (drawing_style().encode(), "text/css")}
