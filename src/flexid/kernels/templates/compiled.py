"""Options to compile functions of every sample, calls of a model, and parts of arrays.

In a kernel this template comes before the generated part.
"""

from typing import Any

from llvmlite import ir
from numba import njit, types
from numba.core.cgutils import unpack_tuple
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

# Functions of every sample allocate nothing. So references to arrays need no counts, which would
# cost more than the mathematics. Python does not call these functions, so they have no wrappers,
# which would double the time to compile them.
_UNWRAPPED: dict[str, Any] = {
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}
_AT_EVERY_SAMPLE: dict[str, Any] = {**_UNWRAPPED, "_nrt": False}
rounded: Any = njit(**_AT_EVERY_SAMPLE)  # rounds each product and each sum
uncounted: Any = njit(**_AT_EVERY_SAMPLE, fastmath={"contract"})  # rounds a product and sum once
inner: Any = njit(**_UNWRAPPED, fastmath={"contract"})  # for functions that return tuples, arrays
# For functions that are short, or called once: a call would pass all numbers of a model.
inlined: Any = njit(**_AT_EVERY_SAMPLE, fastmath={"contract"}, forceinline=True)
allocating: dict[str, Any] = {"error_model": "numpy", "no_cpython_wrapper": True}
equations: dict[str, Any] = {"cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}


def _call(_: Any, address, *arguments):
    """Call a compiled function of a model by its address; arrays are passed as pointers."""
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


def _part(_: Any, numbers, first, size):
    """Return `size` numbers from index `first` on as an array, without the checks of a slice."""
    array = types.Array(numbers.dtype, 1, "C")

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        numbers, first, size = arguments
        if isinstance(signature.args[0], types.Array):
            numbers = context.make_array(signature.args[0])(context, builder, numbers).data
        found = context.make_array(array)(context, builder)
        bytes_each = context.get_constant(types.intp, 8)
        data = builder.gep(numbers, [first])
        populate_array(found, data, [size], [bytes_each], bytes_each, None)
        return found._getvalue()

    return array(numbers, first, size), code


part: Any = intrinsic(_part)
