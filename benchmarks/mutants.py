"""Mutation testing of the modules that determine a result.

``python -m benchmarks.mutants --sample 25 --write`` changes one operator, number or keyword of a
file at a time, in a copy of the commit, and runs the short tests of the file until one fails. A
change survives if no test fails. ``--at COMMIT`` measures an earlier state. The results are stored
in ``mutants.json``, where notes on survivors are added by hand, and shown in
``docs/reliability.md`` and ``mutants.md``.
"""

import argparse
import importlib
import importlib.util
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.mutants_page import keep, kept, show, table
from benchmarks.mutations import changes
from benchmarks.size import sized

SEED = 1
_SHARED = ("matplotlib.figure", "numba", "polars", "pydantic", "scipy.signal", "sympy")
_PATIENCE = 5.0  # times the tests' duration, plus a minute; a longer run counts as failed

_JUDGED = "test_judgement test_sentences test_intervals test_excitations test_doubts"
_JUDGED += " test_estimate test_compliance test_prior_knowledge test_found"
_STRUCTURE = "test_structure test_model_choice test_validation"
_TEXTS = "test_texts test_text test_odd_text test_odd_logs test_read test_column_map"

FILES = {
    "identification/judgement.py": ("judge", _JUDGED),
    "identification/judgement/*.py": ("judge", _JUDGED),
    "identification/structure/elimination.py": (
        "search",
        f"{_STRUCTURE} test_whole_identification",
    ),
    "identification/structure/choice.py": ("search", f"{_STRUCTURE} test_whole_identification"),
    "identification/structure/gap.py": ("search", f"{_STRUCTURE} test_gap"),
    "identification/structure/shapes.py": ("search", f"{_STRUCTURE} test_sought_shape"),
    "identification/structure/sought_terms.py": ("search", f"{_STRUCTURE} test_sought_shape"),
    "estimators/cluster_covariance.py": (
        "covariance",
        "test_block_sandwich test_shrunken_covariance test_cluster_covariance "
        "test_recursive_least_squares test_streamed_least_squares test_state_variable_filter",
    ),
    "identification/estimation/final_fits.py": ("covariance", f"test_excitations {_JUDGED}"),
    "recording/units.py": ("units", f"test_units test_names test_column_map {_TEXTS}"),
    "recording/text.py": ("reading", f"{_TEXTS} test_bad_files"),
    "recording/table.py": ("reading", f"{_TEXTS} test_clock test_bad_files"),
    "recording/names.py": ("reading", f"test_names {_TEXTS} test_survey test_overview"),
}
"""Files of the package, with their present and former names: part, and tests, short ones first."""


def noticed(clone: Path, tests: list[str], limit: float) -> bool:
    """Return whether a test fails or takes too long; the tests' imports are already loaded."""
    child = os.fork()
    if child == 0:
        os.setsid()
        os.chdir(clone)
        nothing = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(nothing, stream)
        for name in [name for name in sys.modules if name.split(".")[0] == "benchmarks"]:
            del sys.modules[name]
        os.environ["PYTHONPATH"] = str(clone / "src")
        sys.path[:0] = [str(clone / "src")]
        import pytest

        os._exit(pytest.main(["-x", "-q", "-n0", "-p", "no:cacheprovider", *tests]))
    end = time.monotonic() + limit
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return status != 0
        time.sleep(0.05)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return True


def measure(
    clone: Path, file: Path, tests: list[str], sample: int, left: list[dict[str, Any]] | None
) -> dict[str, Any]:
    """Return the number of changes of a file, and the survivors.

    Raises
    ------
    RuntimeError
        If a test fails without a change.
    """
    path = clone / file
    source = path.read_bytes()
    begun = time.monotonic()
    if noticed(clone, tests, 3600.0):
        raise RuntimeError(f"the tests of {file} fail without a change: {' '.join(tests)}")
    limit = 60.0 + _PATIENCE * (time.monotonic() - begun)
    every = changes(source)
    drawn = random.Random(f"{SEED} {file.name}").sample(every, min(sample, len(every)))
    survivors = []
    for line, before, after, whole in sorted(drawn, key=lambda change: change[0]):
        if left is not None and not any((before, after) == (s["before"], s["after"]) for s in left):
            continue
        path.write_bytes(whole)
        if not noticed(clone, tests, limit):
            survivors.append({"line": line, "before": before, "after": after, "note": ""})
            print(f"{file}:{line}  {before} -> {after}", flush=True)
    path.write_bytes(source)
    print(f"{file}: {len(drawn)} of {len(every)}, {len(survivors)} survive", flush=True)
    return {"mutants": len(drawn), "survivors": survivors}


def cloned(commit: str, folder: Path) -> Path:
    """Copy the files of a commit, or the present ones, into a folder, and return it."""
    if commit:
        packed = subprocess.run(["git", "archive", commit], check=True, stdout=subprocess.PIPE)
        subprocess.run(["tar", "-x", "-C", str(folder)], check=True, input=packed.stdout)
        return folder
    package = importlib.util.find_spec("flexid")
    assert package is not None
    assert package.origin is not None
    root = Path(package.origin).parents[2]
    for name in ("src", "tests", "benchmarks", "examples", "experiments", "docs"):
        shutil.copytree(root / name, folder / name)
    shutil.copy(root / "pyproject.toml", folder)
    return folder


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutants", description=__doc__)
    parser.add_argument("only", nargs="*", metavar="FILE", help="name of a file, such as units.py")
    parser.add_argument("--sample", type=int, default=25, help="changes of a file")
    parser.add_argument("--at", default="", metavar="COMMIT", help="an earlier state")
    parser.add_argument("--write", action="store_true", help="keep the results and write the page")
    parser.add_argument("--again", action="store_true", help="only what survived last time")
    parser.add_argument("--pages", action="store_true", help="only write pages of what is kept")
    options = parser.parse_args()
    if options.pages:
        show()
        return
    state = options.at or "now"
    for name in _SHARED:
        importlib.import_module(name)
    results: dict[str, Any] = {state: {}}
    with tempfile.TemporaryDirectory() as folder:
        clone = cloned(options.at, Path(folder))
        for wanted, (part, names) in FILES.items():
            for path in sorted(clone.glob(f"src/flexid/{wanted}")):
                if options.only and path.name not in options.only:
                    continue
                file = path.relative_to(clone)
                near = clone / "tests" / file.parts[2]
                tests = [
                    str(near / f"{name}.py") for name in sized(names.split(), names.split()[:1])
                ]
                tests = [test for test in tests if Path(test).exists()]
                old = kept().get(state, {}).get(str(file)) if options.again else None
                sample, left = (old["mutants"], old["survivors"]) if old else (options.sample, None)
                found = {"part": part, **measure(clone, file, tests, sample, left)}
                results[state][str(file)] = found
                if options.write:
                    keep(state, str(file), found)
    print(*table(results), sep="\n")


if __name__ == "__main__":
    main()
