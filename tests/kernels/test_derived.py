"""The generated sources that are part of the package are what is generated."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from flexid.identification.preparation.joint import flexible, rigid
from flexid.kernels import store

FOLDER = Path(store.__file__).parent / "derived"
JOINT, STIFF = flexible(), rigid()
KERNELS = [
    ("segmented_motion", "motion_kernel", JOINT.system),
    ("segmented_motion", "motion_kernel", JOINT.extended),
    ("segmented_motion", "motion_kernel", STIFF.system),
    ("state_variable_filter", "signals", JOINT.smooth),
    ("state_variable_filter", "signals", STIFF.smooth),
    ("parametric_observer", "_kernel", JOINT.smooth),
]
"""Of what `flexid identify` has to compile for a usual drive: module, function, model."""


@pytest.fixture
def generated(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Return each source by the name of its file."""
    found: dict[str, str] = {}

    def build_only(
        task: str, declarations: list[str], build: Callable[[], str], _templates: Any = ()
    ) -> ModuleType:
        found[store.shipped_name(task, declarations)] = build()
        return ModuleType(task)

    for name, function, system in KERNELS:
        module = import_module(f"flexid.estimators.{name}")
        monkeypatch.setattr(module, "load_kernel", build_only)
        vars(module)[function](system)
    return found


def test_shipped_sources_are_those_that_are_generated(
    generated: dict[str, str], request: pytest.FixtureRequest
) -> None:
    """Assert that no file is stale, missing or left over; --update-golden writes them."""
    if request.config.getoption("--update-golden"):
        FOLDER.mkdir(exist_ok=True)
        for path in FOLDER.iterdir():
            path.unlink()
        for name, text in generated.items():
            (FOLDER / name).write_text(text, "utf-8")
    assert {path.name: path.read_text("utf-8") for path in FOLDER.iterdir()} == generated
