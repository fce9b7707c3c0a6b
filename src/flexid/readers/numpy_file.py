"""NumPy's files, by NumPy."""

from pathlib import Path

import numpy as np

from flexid.readers.arrays import Arrays
from flexid.readers.contents import Contents


def read(path: Path) -> Contents:
    """The signals of an .npz or .npy file: vectors, columns of matrices, fields of records."""
    loaded = np.load(path, allow_pickle=False)
    names = loaded.files if isinstance(loaded, np.lib.npyio.NpzFile) else [path.stem]
    found = Arrays("[]")
    for name in names:
        try:
            array = loaded[name] if isinstance(loaded, np.lib.npyio.NpzFile) else loaded
        except ValueError:  # they could hold any program
            found.others[name] = "objects, which are not read"
            continue
        for field in array.dtype.names or ("",):
            values = array[field] if field else array
            path_of = f"{name}.{field}" if field else name
            found.add(path_of, values.shape, values.dtype, values.__getitem__)
    return found.contents()
