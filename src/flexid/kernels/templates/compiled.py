"""How the functions of a kernel of no model are compiled, and how they call a model's."""

from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

# What runs at every sample allocates nothing, and Python does not call it.
_AT_EVERY_SAMPLE: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract"},
    "_nrt": False,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}
uncounted = njit(**_AT_EVERY_SAMPLE)
inlined = njit(**_AT_EVERY_SAMPLE, forceinline=True)
equations: dict[str, Any] = {"cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}


def _call(_: Any, address, work, columns, place, span, h, source, target, what):
    """Call a model by its address: its function `run`, see the template ``model``."""
    signature = types.void(address, work, columns, place, span, h, source, target, what)

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        at, work, columns, *numbers = arguments
        of_work, of_columns = signature.args[1:3]
        real, whole = ir.DoubleType(), ir.IntType(64)
        kinds = [real.as_pointer(), whole.as_pointer(), *[real] * 3, *[whole] * 3]
        pointers = (
            context.make_array(of_work)(context, builder, work).data,
            context.make_array(of_columns)(context, builder, columns).data,
        )
        function = builder.inttoptr(at, ir.FunctionType(ir.VoidType(), kinds).as_pointer())
        builder.call(function, [*pointers, *numbers])
        return context.get_dummy_value()

    return signature, code


call: Any = intrinsic(_call)
