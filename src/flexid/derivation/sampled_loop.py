"""Source of a sampled-data loop: plant, sampled observer, and the control law at a sample."""

from flexid.control.loop import LoopDeclaration
from flexid.derivation.closed_loop import control_law
from flexid.derivation.loop_source import loop_function
from flexid.derivation.model_functions import right_hand_side_function
from flexid.derivation.sampled_observer import sampled_observer_functions
from flexid.derivation.symbolic import symbolic_system


def sampled_loop_source(declaration: LoopDeclaration) -> str:
    """Source of ``right_hand_side``, ``advance`` and ``control(t, x, p, u)`` of a loop."""
    symbolic = symbolic_system(declaration.system)
    signals, law = control_law(declaration, symbolic)
    purpose = f"Sampled loop with {declaration.controller.name!r}"
    return "\n\n".join(
        (
            sampled_observer_functions(declaration.system, purpose),
            right_hand_side_function(symbolic),
            loop_function(
                declaration,
                signals,
                "control(_t, _x, _p, _u)",
                "_u = input that the law demands at time _t for the measured states _x.",
                {"_x": symbolic.states},
                {f"_u[{i}]": law[u] for i, u in enumerate(symbolic.inputs)},
            ),
        )
    )
