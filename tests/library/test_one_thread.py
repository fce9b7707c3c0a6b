"""Linear algebra has one thread during a call, and the former number afterwards."""

import os
import subprocess
import sys
import threading

import pytest

from flexid.library.arguments import one_thread

REPORT = """
import sys
import threadpoolctl
import scipy.linalg

def counts():
    return {p["num_threads"] for p in threadpoolctl.threadpool_info() if p["user_api"] == "blas"}

import flexid.identification.identify as module

def seen(logs, *_):
    print(*counts())
    raise flexid.SettingError("stop", "here")

import flexid
module.identify = seen
before = counts()
try:
    RUN
except (flexid.SettingError, SystemExit):
    pass
print("as before" if counts() == before else "changed")
"""

CALLS = {
    "library": "flexid.identify(sys.argv[1])",
    "command": "sys.argv[1:1] = ['identify']; from flexid.cli.main import main; main()",
}


@pytest.mark.parametrize("call", CALLS)
def test_whoever_calls_gets_one_thread(examples, call):
    """Assert that a call uses one thread, with two for other code."""
    others = {name: value for name, value in os.environ.items() if name != "OMP_NUM_THREADS"}
    script = REPORT.replace("RUN", CALLS[call])
    done = subprocess.run(
        [sys.executable, "-c", script, str(examples / "flexible_joint.csv")],
        env=others | {"OPENBLAS_NUM_THREADS": "2"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["1", "as", "before"]


class Limits:
    """Stand-in for the library that limits threads, with a count of calls."""

    made = 0
    restored = 0

    def __init__(self, limits, user_api):
        assert (limits, user_api) == (1, "blas")
        type(self).made += 1

    def restore_original_limits(self):
        """Count the call."""
        type(self).restored += 1


def test_calls_at_once_share_a_limit(monkeypatch):
    """Assert that overlapping calls share one limit, removed by the last to end."""
    monkeypatch.setattr("threadpoolctl.threadpool_limits", Limits)
    first_is_in, second_is_in = threading.Event(), threading.Event()

    def first():
        with one_thread():
            first_is_in.set()
            second_is_in.wait()

    thread = threading.Thread(target=first)
    thread.start()
    first_is_in.wait()
    with one_thread():
        second_is_in.set()
        thread.join()
        assert (Limits.made, Limits.restored) == (1, 0)
    assert (Limits.made, Limits.restored) == (1, 1)
