from benchmarks.accuracy import merged


def results(**runs: list[tuple[str, float]]) -> dict:
    """Results by tool; a run is the kind of log and its time."""
    return {
        "tools": {
            tool: {"runs": [{"case": case, "seed": 0, "seconds": time} for case, time in found]}
            for tool, found in runs.items()
        }
    }


def times(found: dict, tool: str) -> list[tuple[str, float]]:
    """Runs of a tool as they were put in."""
    return [(run["case"], run["seconds"]) for run in found["tools"][tool]["runs"]]


def test_new_runs_replace_those_of_the_same_tool_and_log_only():
    """Assert that other logs' runs and other tools are kept, in the order of the logs."""
    kept = results(numpy=[("noise × 1", 1.0), ("example log", 2.0)], casadi=[("noise × 1", 3.0)])
    found = results(numpy=[("noise × 1", 4.0)])
    together = merged(kept, found)
    assert times(together, "numpy") == [("noise × 1", 4.0), ("example log", 2.0)]
    assert times(together, "casadi") == [("noise × 1", 3.0)]


def test_tools_come_in_the_order_of_the_page():
    """Assert that the order of runs does not reorder the page."""
    together = merged(results(casadi=[("noise × 1", 1.0)]), results(numpy=[("noise × 1", 1.0)]))
    assert list(together["tools"]) == ["numpy", "casadi"]
