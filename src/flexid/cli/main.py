"""The ``flexid`` command: it answers an interruption before anything else is imported."""

import gc
import os
import signal
import sys
from types import FrameType

_INTERRUPTED = 3  # as in flexid.cli.generated.ExitStatus
_COLLECTED = (1_000_000, 20, 100)
"""Objects between two searches for garbage, and searches of one generation for one of the next:
what is imported stays, and to go through it once takes a thirtieth of a command's time. Fits leave
next to nothing that only a search frees."""


class _Interrupted(KeyboardInterrupt):
    """An interruption that Python does not take for one that nobody answers."""

    # Where a bare KeyboardInterrupt has passed through exec of a text, by which dataclasses make
    # classes, python -m ends by a signal at its exit, whoever caught it meanwhile.


def _hung_up(_number: int, _frame: FrameType | None) -> None:
    """Take the end of the terminal for a request to end, whoever answers that by now."""
    signal.raise_signal(signal.SIGTERM)


def main() -> None:
    """Run the command line; its exit status is an `ExitStatus`."""
    gc.set_threshold(*_COLLECTED)
    interruptions: list[int] = []

    def interrupted(number: int, _frame: FrameType | None) -> None:
        interruptions.append(number)
        if len(interruptions) > 1:  # whoever asks twice wants no cleaning up
            os._exit(_INTERRUPTED)
        raise _Interrupted

    before = {}
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            before[number] = signal.signal(number, interrupted)
        if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
            before[signal.SIGHUP] = signal.signal(signal.SIGHUP, _hung_up)  # unless nohup
        from flexid.cli.commands import run

        status = run()
    except BaseException:
        if not interruptions:
            raise
        status = 0
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if interruptions and status != _INTERRUPTED:  # whatever was made of it on the way
        status = _INTERRUPTED
        print("flexid: interrupted; nothing half written is left", file=sys.stderr)
    gc.freeze()  # or the interpreter's end, too, looks through all for garbage
    sys.exit(status)
