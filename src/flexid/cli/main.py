"""The ``flexid`` command: handles interruptions before it imports anything else."""

import gc
import os
import signal
import sys
from types import FrameType

_INTERRUPTED = 3  # as in flexid.cli.generated.ExitStatus
_GC_THRESHOLDS = (1_000_000, 20, 100)
"""Thresholds of the garbage collector. Imported objects stay until the end, and one collection of
them takes a thirtieth of a command's time. Fits leave almost no reference cycles."""


class _Interrupted(KeyboardInterrupt):
    """Interruption that lets ``python -m`` exit with the status of the command."""

    # If a plain KeyboardInterrupt passes through exec of a text, which dataclasses use, python -m
    # ends by a signal at its exit, even if the exception was caught.


def _on_hangup(_number: int, _frame: FrameType | None) -> None:
    """Treat a closed terminal as SIGTERM, with the handler that is installed by then."""
    signal.raise_signal(signal.SIGTERM)


def main() -> None:
    """Run the command line, and exit with an `ExitStatus`."""
    gc.set_threshold(*_GC_THRESHOLDS)
    interruptions: list[int] = []

    def interrupted(number: int, _frame: FrameType | None) -> None:
        interruptions.append(number)
        if len(interruptions) > 1:  # the second interruption ends without cleaning up
            os._exit(_INTERRUPTED)
        raise _Interrupted

    before = {}
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            before[number] = signal.signal(number, interrupted)
        if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
            before[signal.SIGHUP] = signal.signal(signal.SIGHUP, _on_hangup)  # not under nohup
        from flexid.cli.commands import run

        status = run()
    except BaseException:
        if not interruptions:
            raise
        status = 0
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if interruptions and status != _INTERRUPTED:  # another status replaced it on the way
        status = _INTERRUPTED
        print("flexid: interrupted; no half-written file is left", file=sys.stderr)
    gc.freeze()  # else the interpreter collects garbage once more at its end
    sys.exit(status)
