"""Every benchmark has a smoke run."""

from pathlib import Path

from benchmarks.smoke import JOBS

FOLDER = Path(__file__).parents[2] / "benchmarks"
PARTS = {"batch", "long_log", "fuzz_guided", "smoke"}
"""Programs that a benchmark starts, and the smoke run itself."""
PICTURES = {"studio_pictures"}
"""What measures nothing."""


def test_no_benchmark_is_left_out():
    """Assert that each program among the benchmarks is run at its smallest."""
    single = {p.stem for p in FOLDER.glob("[a-z]*.py") if _is_program(p.read_text("utf-8"))}
    packages = {path.parent.name for path in FOLDER.glob("*/__main__.py")}
    assert {job.module for job in JOBS} == (single | packages) - PARTS - PICTURES


def _is_program(text: str) -> bool:
    return 'if __name__ == "__main__":' in text or "def run(quick: bool)" in text
