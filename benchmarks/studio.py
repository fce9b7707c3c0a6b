"""Memory and response time of the studio with many windows.

``python -m benchmarks.studio`` opens twenty windows, sends each a log of thirty seconds, and checks
and identifies all logs while another window sends requests.
``python -m benchmarks.studio --play 200`` runs Play with 200 settings of its sliders.
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from math import exp, log
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

if TYPE_CHECKING:
    from flexid.studio.play import Slider

LOG = Path(__file__).parents[1] / "examples" / "flexible_joint.csv"
PATIENCE = 600.0  # s


class Visitor:
    """A window without a browser.

    Parameters
    ----------
    address : str
        Address of the studio.
    connection : ClientConnection
        Connection to its websocket.
    """

    def __init__(self, address: str, connection: ClientConnection) -> None:
        self._address = address
        self._connection = connection
        self.ask("open", values={})
        self._key = self.wait(lambda message: message["kind"] == "opened")["key"]

    def ask(self, kind: str, **more: Any) -> None:
        """Send a request, as the page's script does."""
        request = {"kind": kind, "asked": time.monotonic(), **more}
        self._connection.send(json.dumps(request))

    def wait(
        self, wanted: Callable[[dict[str, Any]], bool], *, problems: bool = False
    ) -> dict[str, Any]:
        """Wait for a message; raise if the page would show an unexpected problem."""
        while True:
            found = json.loads(self._connection.recv(PATIENCE))
            if not problems and 'class="problem"' in found.get("html", ""):
                raise RuntimeError(found["html"])
            if wanted(found):
                return found

    def shown(self, place: str, text: str) -> None:
        """Wait until a place of the page contains a text."""
        self.wait(lambda m: m["kind"] == "show" and m["place"] == place and text in m["html"])

    def send(self, log: Path) -> None:
        """Upload a log."""
        headers = {"X-File-Name": log.name, "Origin": self._address.rstrip("/")}
        url = f"{self._address}upload/{self._key}"
        urlopen(Request(url, log.read_bytes(), headers), timeout=PATIENCE).close()

    def answer_time(self) -> float:
        """Return the time until an invalid setting is refused, in s."""
        begun = time.monotonic()
        self.ask("settings", values={"model": "none"})
        self.wait(lambda message: message.get("place") == "check-charts", problems=True)
        return time.monotonic() - begun

    def play_time(self, values: dict[str, str]) -> float:
        """Return the time of a run with given sliders, in s."""
        begun = time.monotonic()
        self.ask("play", values=values)
        self.wait(lambda message: message["kind"] == "played", problems=True)
        return time.monotonic() - begun


@contextmanager
def running(*arguments: object) -> Iterator[tuple[int, str]]:
    """Start a studio and yield its process and its address."""
    options = ["--port", "0", "--no-browser", *map(str, arguments)]
    command = [sys.executable, "-m", "flexid", "studio", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.pid, process.stdout.readline().split()[2]
        process.terminate()


def memory(process: int) -> int:
    """Return the memory of a process and its children in bytes, shared pages counted once."""
    children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    own = 0
    for line in Path(f"/proc/{process}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss:"):
            own = 1024 * int(line.split()[1])
    return own + sum(memory(int(child)) for child in children)


@dataclass(frozen=True)
class Load:
    """Cost of many windows: times in s and memory in bytes."""

    checked: float
    identified: float
    slowest_answer: float
    peak_memory: int


def load(windows: int, identified: int) -> Load:
    """Open windows, send each a log, and identify in some of them."""
    with running() as (process, address), ExitStack() as stack:
        peak, answers = [0], [0.0]
        over = threading.Event()

        def watch() -> None:
            while not over.wait(0.2):
                peak[0] = max(peak[0], memory(process))

        watching = threading.Thread(target=watch)
        watching.start()
        stack.callback(watching.join)
        stack.callback(over.set)
        origin = address.rstrip("/")
        socket = f"ws://{urlsplit(address).netloc}/socket"
        connections = [
            stack.enter_context(
                connect(socket, origin=Origin(origin), max_size=None, max_queue=None)
            )
            for _ in range(windows + 1)
        ]
        visitors = [Visitor(address, connection) for connection in connections]
        *visitors, asking = visitors
        begun = time.monotonic()
        for visitor in visitors:
            visitor.send(LOG)
        for visitor in visitors:
            visitor.shown("check", "Check before you run")
            answers.append(asking.answer_time())
        checked = time.monotonic() - begun
        for visitor in visitors[:identified]:
            visitor.ask("run", values={})
        for visitor in visitors[:identified]:
            visitor.shown("result", "The result")
            answers.append(asking.answer_time())
        spent = time.monotonic() - begun
        return Load(checked, spent - checked, max(answers), peak[0])


def play_times(places: int) -> list[float]:
    """Return the times in s of runs with sliders drawn evenly, compared with Table I's run."""
    from flexid.studio.play import READINGS, SLIDERS

    rng = random.Random(1)

    def somewhere(slider: Slider) -> str:
        ends = slider.lowest, slider.highest
        value = exp(rng.uniform(*map(log, ends))) if slider.logarithmic else rng.uniform(*ends)
        return f"{value:.4g}"

    with running() as (_, address):
        origin = address.rstrip("/")
        socket = f"ws://{urlsplit(address).netloc}/socket"
        with connect(socket, origin=Origin(origin), max_size=None, max_queue=None) as connection:
            visitor = Visitor(address, connection)
            for reading in READINGS:  # compiles both readings
                visitor.play_time({"reading": reading})
            return [
                visitor.play_time(
                    {slider.name: somewhere(slider) for slider in SLIDERS}
                    | {"reading": rng.choice([*READINGS])}
                )
                for _ in range(places)
            ]


def main() -> None:
    """Print the cost of twenty windows, or of settings of the sliders."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--windows", type=int, default=20)
    parser.add_argument("--play", type=int, metavar="PLACES")
    arguments = parser.parse_args()
    if arguments.play:
        times = sorted(play_times(arguments.play))
        for share in (0.5, 0.9, 1.0):
            print(f"{share:4.0%} of places within {times[round(share * len(times)) - 1]:.3f} s")
        return
    found = load(arguments.windows, arguments.windows)
    print(f"windows              {arguments.windows}")
    print(f"all logs checked     {found.checked:.1f} s")
    print(f"all identified       {found.identified:.1f} s")
    print(f"slowest answer       {found.slowest_answer:.2f} s")
    print(f"most memory          {found.peak_memory / 1e9:.2f} GB")


if __name__ == "__main__":
    main()
