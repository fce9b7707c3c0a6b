"""The style sheets of a page and of the studio."""

import base64
import hashlib
from functools import cache
from pathlib import Path

_HERE = Path(__file__).parent


@cache
def drawing_style() -> str:
    """The style sheet of figures, with the colours by day and by night."""
    return _text("chart.css")


@cache
def page_style() -> str:
    """The style sheet of a page."""
    return f"{drawing_style()}\n{_text('page.css')}"


def content_hash(text: str) -> str:
    """How a Content-Security-Policy names a script or a style sheet within a page."""
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


def _text(name: str) -> str:
    return (_HERE / name).read_text(encoding="utf-8")
