"""Compare MuJoCo's sysid and PySINDy with flexid on logs of the blind trials.

    python -m benchmarks.rivals [--seeds N] [--first-seed K] [--family F ...] [--tool T ...]
                                [--out FILE] [--page]
    python -m benchmarks.rivals --render

in the root of a clone, with the extra ``benchmarks``. Seeds below 1000 are for development.
"""

import argparse
import datetime
import importlib.util
import json
import os
import platform
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is imported

from benchmarks.page_block import write_block
from benchmarks.report import processor
from benchmarks.rivals.page import BLOCK, PAGE, RESULTS, render
from benchmarks.rivals.tools import FAMILIES, TOOLS, record
from benchmarks.trials.options import add_log_options
from benchmarks.trials.run import commit


def main() -> None:
    """Run the tools and print the results."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.rivals",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_log_options(parser, 2, FAMILIES)
    parser.add_argument("--tool", action="append", choices=list(TOOLS), help="may be repeated")
    parser.add_argument("--out", type=Path, default=None, help="file that the results go into")
    parser.add_argument("--page", action="store_true", help="make the tables of the page again")
    parser.add_argument("--render", action="store_true", help="from the results that are there")
    options = parser.parse_args()
    if options.render:
        results = json.loads(RESULTS.read_text(encoding="utf-8"))
    else:
        results = _results(options)
        out = options.out or RESULTS
        if out.exists():
            results = merged(json.loads(out.read_text(encoding="utf-8")), results)
        out.write_text(_text(results), encoding="utf-8")
    print(render(results))
    if options.page or options.render:
        write_block(PAGE, BLOCK, render(results))


def _results(options: argparse.Namespace) -> dict[str, Any]:
    tools = []
    for key in options.tool or TOOLS:
        if importlib.util.find_spec(TOOLS[key].package) is None:
            print(f"{TOOLS[key].title} left out: not installed", file=sys.stderr)
        else:
            tools.append(key)
    for key in tools:
        if key != "mujoco":
            record(key, "basic", 0)  # compilation and imports are not timed
    records = []
    for family in options.family or FAMILIES:
        for seed in range(options.first_seed, options.first_seed + options.seeds):
            for key in tools:
                records.append(record(key, family, seed))
                print(json.dumps(records[-1]), file=sys.stderr)
    about = {
        "command": " ".join(["python -m benchmarks.rivals", *sys.argv[1:]]),
        "date": str(datetime.datetime.now(datetime.UTC).date()),
        "commit": commit(),
        "machine": f"{processor()}, {os.cpu_count()} cores, {platform.system()}",
        "python": platform.python_version(),
    }
    versions = {key: version(TOOLS[key].package) for key in tools}
    return {"runs": [about], "versions": versions, "records": records}


def merged(old: dict[str, Any], new: dict[str, Any]) -> dict[str, Any]:
    """Return old and new records; for the same log and tool, the new one."""
    records = {(r["family"], r["seed"], r["tool"]): r for r in old["records"] + new["records"]}
    return {
        "runs": old["runs"] + new["runs"],
        "versions": old["versions"] | new["versions"],
        "records": [records[key] for key in sorted(records)],
    }


def _text(results: dict[str, Any]) -> str:
    """Return the records as JSON with a line for each log."""
    records = ",\n".join(json.dumps(item) for item in results["records"])
    about = json.dumps({k: v for k, v in results.items() if k != "records"}, ensure_ascii=False)
    return f'{about[:-1]},\n"records": [\n{records}\n]}}\n'


if __name__ == "__main__":
    main()
