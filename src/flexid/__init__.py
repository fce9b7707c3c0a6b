"""flexid: physical parameters of flexible-joint drives from their motion, without accelerations.

``__init__.pyi`` lists the public names. Each is imported at its first use.
"""

import re
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any

__version__ = "0.1.0"

_STUB = Path(__file__).with_name("__init__.pyi").read_text(encoding="utf-8")
_IMPORT = re.compile(r"^from flexid\.([\w.]+) import \(?\s*(\w+) as", re.MULTILINE)
_MODULES = {name: home for home, name in _IMPORT.findall(_STUB)}
"""Module of each public name, read from the stub for type checkers."""

__all__ = ["__version__"]
__all__ += _MODULES  # pyright: ignore[reportUnsupportedDunderAll] - __init__.pyi declares them


def __getattr__(name: str) -> Any:
    home = _MODULES.get(name)
    if home is None:
        # Python appends a similar name to the message, if there is one.
        raise AttributeError(f"flexid has no {name!r}", name=name, obj=import_module(__name__))
    value = getattr(import_module(f"{__name__}.{home}"), name)
    if isinstance(value, FunctionType) and not hasattr(value, "__wrapped__"):  # of a lower package
        value = import_module(f"{__name__}.library.arguments").entrance(value)
        value.__module__, value.__qualname__ = __name__, name  # pickle finds it here
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
