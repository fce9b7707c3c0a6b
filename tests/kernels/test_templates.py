"""The types of generated functions that templates are checked against."""

import ast
from pathlib import Path

from flexid.derivation.model_functions import compiled_signals
from flexid.derivation.sensitivities import sensitivity_functions
from flexid.kernels import store
from flexid.models.flexible_joint import flexible_joint
from flexid.paper.closed_loop import compose_loop, lane_loop_source, stiff_loop_source
from flexid.paper.laws import pd_gravity
from flexid.paper.loop import LoopDeclaration, sinusoid
from flexid.paper.sampled_loop import sampled_loop_source

FOLDER = Path(store.__file__).parent / "templates"
JOINT = flexible_joint(known={"beta1": 3.0})


def test_stub_has_the_arguments_that_are_generated() -> None:
    """Assert that the types of generated functions are those of functions that exist."""
    declaration = LoopDeclaration(JOINT, pd_gravity(), sinusoid(1.0, 2.0))
    law = compose_loop(declaration)
    sources = [
        compiled_signals(JOINT),
        sensitivity_functions(JOINT, "Test"),
        sampled_loop_source(declaration),
        stiff_loop_source(law),
        lane_loop_source(law, 2),
    ]
    generated = {name: value for source in sources for name, value in signatures(source).items()}
    stub = signatures((FOLDER / "generated.pyi").read_text("utf-8"))
    assert stub.items() <= generated.items()


def signatures(source: str) -> dict[str, list[str]]:
    """Return the arguments of each function of a source, by the function's name."""
    functions = [node for node in ast.parse(source).body if isinstance(node, ast.FunctionDef)]
    return {f.name: [argument.arg for argument in f.args.args] for f in functions}
