"""What one sample of a fit costs: the motion, its derivatives and their normal equations.

    python -m benchmarks.derivatives [LOG]

The kernel of prediction error is compiled as it is; with references to arrays counted; and with
functions called instead of put in their place, too. All of them run the same fits of the log.
"""

from __future__ import annotations

import importlib.util
import sys
import tempfile
import time
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import flexid
from benchmarks.size import sized
from flexid.estimators import segmented_motion

_EXAMPLE = Path("examples/flexible_joint.csv")
_COUNTED = (", _nrt=False", "")
_CALLED = (", forceinline=True", "")
_VARIANTS = {
    "as it is": (),
    **sized({"references counted": (_COUNTED,), "and functions called": (_COUNTED, _CALLED)}, {}),
}
_REPETITIONS = 7
_FEWEST = sized(10_000, 100)  # samples of a fit that is timed


def fits_of(log: Path) -> list[tuple[ModuleType, tuple[Any, ...]]]:
    """Kernel and arguments of one run of every size that identifying a log makes."""
    found: dict[tuple[int, ...], tuple[ModuleType, tuple[Any, ...]]] = {}
    load = segmented_motion.load_kernel

    def watched(*arguments: Any) -> ModuleType:
        kernel = load(*arguments)
        copy = ModuleType(kernel.__name__)
        vars(copy).update(vars(kernel))

        def segment_equations(part: Any, segments: Any, *rest: Any) -> None:
            kernel.segment_equations(part, segments, *rest)
            normal, substeps = rest[-1][0], rest[-3]
            whole = (0, len(segments[0])), segments, *rest
            found.setdefault((len(segments[0]), normal.shape[1], substeps), (kernel, whole))

        vars(copy)["segment_equations"] = segment_equations
        return copy

    segmented_motion.load_kernel = watched
    try:
        flexid.identify(log)
    finally:
        segmented_motion.load_kernel = load
    return [fit for fit in found.values() if int(fit[1][1][1].sum()) >= _FEWEST]


def variant(kernel: ModuleType, changes: tuple[tuple[str, str], ...], folder: Path) -> ModuleType:
    """The kernel compiled in another way."""
    text = Path(str(kernel.__file__)).read_text("utf-8").replace("cache=True, ", "")
    for old, new in changes:
        text = text.replace(old, new)
    path = folder / f"{kernel.__name__}_{len(changes)}.py"
    path.write_text(text, "utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def nanoseconds(kernel: ModuleType, arguments: tuple[Any, ...]) -> float:
    """Least processor time per sample."""
    times = []
    for _ in range(_REPETITIONS):
        fresh = tuple(np.zeros_like(result) for result in arguments[-1])
        began = time.process_time()
        kernel.segment_equations(*arguments[:-1], fresh)
        times.append(time.process_time() - began)
    return 1e9 * min(times[1:]) / int(arguments[1][1].sum())


def main() -> None:
    """Print a line for each size."""
    fits = fits_of(Path(sys.argv[1]) if len(sys.argv) > 1 else _EXAMPLE)
    fits = sized(fits, fits[:1])
    with tempfile.TemporaryDirectory() as folder:
        kernels = {kernel.__name__: kernel for kernel, _ in fits}
        compiled = {
            (name, words): variant(kernels[name], _VARIANTS[words], Path(folder))
            for name, words in product(kernels, _VARIANTS)
        }
        print("sought  steps  segments  ns a sample: " + ", ".join(_VARIANTS))
        for kernel, arguments in sorted(fits, key=lambda f: (f[1][-1][0].shape[1], f[1][4])):
            size, substeps, count = arguments[-1][0].shape[1], arguments[4], len(arguments[1][0])
            times = (nanoseconds(compiled[kernel.__name__, w], arguments) for w in _VARIANTS)
            print(f"{size:6d} {substeps:6d} {count:9d}  " + "  ".join(f"{t:5.0f}" for t in times))


if __name__ == "__main__":
    main()
