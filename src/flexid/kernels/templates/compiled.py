"""How the functions of a kernel of no model are compiled, and how they call a model's."""

from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.core.cgutils import unpack_tuple
from numba.extending import intrinsic

# What runs at every sample allocates nothing, and Python does not call it.
_AT_EVERY_SAMPLE: dict[str, Any] = {
    "error_model": "numpy",
    "_nrt": False,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}
rounded = njit(**_AT_EVERY_SAMPLE)  # each product and each sum
uncounted = njit(**_AT_EVERY_SAMPLE, fastmath={"contract"})  # a product and its sum at once
inlined = njit(**_AT_EVERY_SAMPLE, fastmath={"contract"}, forceinline=True)
allocating: dict[str, Any] = {"error_model": "numpy", "no_cpython_wrapper": True}
equations: dict[str, Any] = {"cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}


def _call(_: Any, address, *arguments):
    """Call a compiled function of a model by its address; of arrays it gets the numbers."""
    given: Any = types.BaseTuple.from_types(arguments)

    def code(context: Any, builder: Any, _: Any, values: Any) -> Any:
        at, packed = values
        numbers = [
            context.make_array(kind)(context, builder, value).data
            if isinstance(kind, types.Array)
            else value
            for kind, value in zip(given.types, unpack_tuple(builder, packed), strict=True)
        ]
        kind = ir.FunctionType(ir.VoidType(), [number.type for number in numbers])
        builder.call(builder.inttoptr(at, kind.as_pointer()), numbers)
        return context.get_dummy_value()

    return types.void(address, given), code


call: Any = intrinsic(_call)
