"""The most memory that a process has had."""

from pathlib import Path


def most_memory() -> float:
    """Of this process, in MB, by what Linux says of its memory since it was started.

    `resource.getrusage` would count what its parent had when it was forked.
    """
    lines = Path("/proc/self/status").read_text().splitlines()
    (line,) = (line for line in lines if line.startswith("VmHWM"))
    return float(line.split()[1]) / 1e3
