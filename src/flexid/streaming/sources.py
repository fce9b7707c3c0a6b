"""Where a stream comes from: a file that grows, standard input, UDP datagrams, a serial port.

A source is read in turns of a tenth of a second: bytes that have come, none if nothing has, None at
its end. Nothing listens to anything but this machine unless an address says so.
"""

import io
import os
import select
import socket
import sys
import threading
import time
from collections import deque
from ipaddress import ip_address
from pathlib import Path
from typing import TypeAlias
from urllib.parse import parse_qs, urlsplit

from flexid.errors import RecordingError, SettingError
from flexid.files import check_file, shown

WAIT = 0.1  # seconds after which a source says that nothing has come
MOST = 1 << 20  # bytes that are handed over at once

_BUFFER = 4 << 20  # bytes that the system keeps of datagrams, if it lets us have so many
_MOST_WAITING = 1 << 17  # datagrams; beyond it the oldest are lost: their clock shows it
_COMPARED = 256  # bytes, by which a file is known that is read on
_BAUD = 115200
_LOOPBACK = "127.0.0.1"


def open_source(text: str, *, stop_at_end: bool = False) -> "Source":
    """Open a source."""
    if text == "-":
        return StandardInput()
    scheme, separator, _ = text.partition("://")
    if not separator:
        return GrowingFile(Path(text), stop_at_end=stop_at_end)
    if scheme == "udp":
        return Datagrams(text)
    if scheme == "serial":
        return SerialPort(text)
    raise SettingError(
        "source",
        f"{text!r} cannot be opened: give the path of a file, - for standard input, "
        f"udp://{_LOOPBACK}:9000 "
        f"or serial:///dev/ttyUSB0",
    )


class GrowingFile:
    """A text file that a recorder is still writing.

    Before it is read on, its last bytes are compared with those that were read: so one that was
    cut or written again is found, even where it has grown beyond that place.
    """

    def __init__(self, path: Path, *, stop_at_end: bool) -> None:
        self.name = shown(path)
        check_file(path, "a log as text", lambda reason: RecordingError(self.name, "", reason))
        self._path = path
        self._stop_at_end = stop_at_end
        self._last = b""  # of what was read
        try:
            self._file = path.open("rb", buffering=0)
        except OSError as error:
            raise RecordingError(
                self.name, "", f"the file cannot be opened ({error.strerror}): check its rights"
            ) from None

    def read(self) -> bytes | None:
        """What was written since; raise where another text stands there now."""
        self._file.seek(-len(self._last), os.SEEK_CUR)
        found = self._file.read(len(self._last) + MOST)
        new = found.removeprefix(self._last)
        is_other = not found.startswith(self._last) or (not new and self._is_replaced())
        if is_other:
            raise RecordingError(
                self.name,
                "",
                "it was cut, rewritten or replaced while it was watched: watch it once more; a "
                "checkpoint keeps what was learnt",
            )
        self._last = found[-_COMPARED:]
        if new or self._stop_at_end:
            return new or None
        time.sleep(WAIT)
        return b""

    def _is_replaced(self) -> bool:
        """Whether another file stands there now, as where logs are rotated."""
        try:
            return not os.path.samestat(self._path.stat(), os.fstat(self._file.fileno()))
        except OSError:  # it is not there yet
            return False

    def close(self) -> None:
        """Close it."""
        self._file.close()


class StandardInput:
    """What another program writes into this one."""

    name = "standard input"

    def __init__(self) -> None:
        try:
            self._file = sys.stdin.fileno()
        except (AttributeError, ValueError, io.UnsupportedOperation):
            raise SettingError("source", "there is no standard input: give a file") from None

    def read(self) -> bytes | None:
        """What came; a console of Windows keeps us waiting for it."""
        if os.name == "posix" and not select.select([self._file], [], [], WAIT)[0]:
            return b""
        return os.read(self._file, MOST) or None

    def close(self) -> None:
        """Nothing: others may read on."""


class Datagrams:
    """Lines in UDP datagrams, which a thread takes from the system, whose room is small."""

    def __init__(self, text: str) -> None:
        self.name = text
        try:
            parts = urlsplit(text)
            port, host = parts.port, parts.hostname or _LOOPBACK
            address = ip_address(_LOOPBACK if host == "localhost" else host)
            if port is None or parts.path not in ("", "/") or parts.query:
                raise ValueError
        except ValueError:
            raise SettingError(
                "source", f"{text!r} is not an address: give udp://{_LOOPBACK}:9000"
            ) from None
        family = socket.AF_INET6 if address.version == 6 else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        self._socket.settimeout(WAIT)
        try:
            self._socket.bind((str(address), port))
        except OSError as error:
            self._socket.close()
            raise SettingError(
                "source", f"{text} cannot be listened to ({error.strerror}): give another port"
            ) from None
        self.port: int = self._socket.getsockname()[1]  # that the system chose, where 0 was given
        self.is_open_to_others = not address.is_loopback  # whether other machines can send to it
        self._came: deque[bytes] = deque(maxlen=_MOST_WAITING)
        self._some = threading.Event()
        self._closed = False
        self._thread = threading.Thread(target=self._receive, daemon=True)
        self._thread.start()

    def read(self) -> bytes | None:
        """Lines of the datagrams that came."""
        self._some.wait(WAIT)
        self._some.clear()
        came = [self._came.popleft() for _ in range(len(self._came))]
        return b"".join(data if data.endswith(b"\n") else data + b"\n" for data in came)

    def _receive(self) -> None:
        while not self._closed:
            try:
                data = self._socket.recv(65536)
            except OSError:  # nothing for a while; or, on some systems, an answer to nobody
                continue
            self._came.append(data)
            self._some.set()

    def close(self) -> None:
        """Listen no longer."""
        self._closed = True
        self._thread.join()
        self._socket.close()


class SerialPort:
    """Lines from a serial port; needs pyserial."""

    def __init__(self, text: str) -> None:
        self.name = text
        address, _, query = text.removeprefix("serial://").partition("?")
        rates = parse_qs(query, keep_blank_values=True).pop("baud", [str(_BAUD)])
        if not address or not rates[0].isdecimal() or query.partition("=")[0] not in ("", "baud"):
            raise SettingError(
                "source", f"{text!r} is not a port: give serial:///dev/ttyUSB0?baud={_BAUD}"
            )
        try:
            import serial
        except ImportError:
            raise SettingError(
                "source", "a serial port needs pyserial: pip install 'flexid[serial]'"
            ) from None
        try:
            self._port = serial.Serial(address, int(rates[0]), timeout=WAIT)
        except (serial.SerialException, ValueError, OSError) as error:
            number = getattr(error, "errno", None)
            reason = os.strerror(number).lower() if number else str(error)
            raise RecordingError(
                self.name, "", f"the port cannot be opened ({reason}): check its name and rights"
            ) from None
        self._lost = serial.SerialException

    def read(self) -> bytes | None:
        """What came; None where the port is pulled out."""
        try:
            return self._port.read(max(1, min(self._port.in_waiting, MOST)))
        except (self._lost, OSError, TypeError):
            return None

    def close(self) -> None:
        """Give the port back."""
        self._port.close()


Source: TypeAlias = GrowingFile | StandardInput | Datagrams | SerialPort
"""Bytes as they come: `read` returns none if nothing has come for a while, None at the end."""
