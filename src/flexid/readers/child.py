"""Code that runs in the child process: one reader within limits, which answers on a pipe.

Each message is a line of JSON. For a frame it gives the size of the Arrow stream that follows it.
"""

import io
import json
import os
import sys
import warnings
from collections.abc import Iterable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

from flexid.readers.formats import Contents, RefusedError, of_frame

_pipe: BinaryIO | None = None


def main() -> None:
    """Open the file named on the command line: send its contents, then the requested frames."""
    global _pipe
    module, path, memory, seconds = sys.argv[1:]
    _pipe = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # keeps prints of a library out of the answers
    with suppress(ImportError):  # Windows has none
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (int(memory), int(memory)))
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.simplefilter("ignore")
    say(module, Path(path), sys.stdin.buffer)


def say(module: str, path: Path, questions: Iterable[bytes]) -> None:
    """Send the contents of a file, and for each request its frames; send errors as messages."""
    try:
        found = import_module(module).read(path)
        contents = found if isinstance(found, Contents) else of_frame(found)
        for one in contents.series:
            one.path.encode()  # raises for a name that is not valid text
        _write(
            {
                "series": contents.series,
                "others": dict(contents.others),
                "is_table": contents.is_table,
                "notes": dict(contents.notes),
            }
        )
        import polars as pl

        for line in questions:
            asked = json.loads(line)
            for clock, columns in contents.read(asked["paths"], asked["size"]):
                buffer = io.BytesIO()
                pl.DataFrame(columns).write_ipc_stream(buffer)
                _write({"clock": clock, "bytes": buffer.tell()}, buffer.getbuffer())
            _write({"end": True})
    except RefusedError as error:
        _write({"refused": [error.place, error.reason]})
    except ModuleNotFoundError as error:
        _write({"missing": error.name})
    except MemoryError:
        _write({"memory": True})
    except Exception as error:
        # On damaged files, libraries raise any error of their parsers.
        _write({"unreadable": f"{type(error).__name__}: {error}"[:1000]})


def _write(document: dict[str, Any], data: Any = b"") -> None:
    assert _pipe is not None
    _pipe.write(json.dumps(document).encode() + b"\n")
    _pipe.write(data)
    _pipe.flush()
