"""Parts of arrays, as arrays."""

from typing import Any

from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array


def _part(_: Any, numbers, first, size):
    """Numbers from a place on, as an array: without the checks that a slice makes."""
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
