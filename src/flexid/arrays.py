"""The one type of array that the package's functions take and return."""

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray


class _AsLists:
    """Lets pydantic read an array from lists of numbers, without being loaded for it."""

    @staticmethod
    def __get_pydantic_core_schema__(_source: Any, _handler: Any) -> Any:
        from pydantic_core import core_schema

        lists = core_schema.list_schema(core_schema.float_schema())
        either = core_schema.union_schema([lists, core_schema.list_schema(lists)])
        return core_schema.no_info_after_validator_function(_array, either)


def _array(lists: list[Any]) -> NDArray[np.float64]:
    try:
        return np.array(lists, dtype=np.float64)
    except ValueError:
        raise ValueError("its rows differ in length") from None


FloatArray = Annotated[NDArray[np.float64], _AsLists]
