"""Work that takes long, in processes of its own, so that it can be waited for and cancelled.

A compiled kernel cannot be interrupted. Whoever cancels ends the process in which it runs, and the
next job starts a new one.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexid.errors import FlexidError

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Said = Callable[[str], None]
"""Takes a line on how far a job is."""


class JobError(FlexidError):
    """A job did not end as it should."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)


@dataclass(eq=False)
class _Ticket:
    """A job that waits for a worker."""

    said: Said
    turn: asyncio.Future[_Worker] = field(
        default_factory=lambda: asyncio.get_running_loop().create_future()
    )


class Workers:
    """Some processes, shared by all windows; jobs wait in one queue."""

    def __init__(self, most: int) -> None:
        self._idle = [_Worker() for _ in range(most)]
        self._all = tuple(self._idle)
        self._waiting: deque[_Ticket] = deque()

    async def run(self, job: Callable[..., Any], *arguments: Any, folder: Path, said: Said) -> Any:
        """Do a job, and return what it returns.

        Cancel the coroutine to cancel the job, whether it waits or runs.
        """
        worker = await self._turn(_Ticket(said))
        try:
            return await worker.work(job, arguments, folder, said)
        except asyncio.CancelledError:
            worker.end()
            raise
        finally:
            self._idle.append(worker)
            self._hand_out()

    async def _turn(self, ticket: _Ticket) -> _Worker:
        """Wait for a worker."""
        self._waiting.append(ticket)
        self._hand_out()
        try:
            return await ticket.turn
        except asyncio.CancelledError:
            if ticket in self._waiting:
                self._waiting.remove(ticket)
            elif ticket.turn.done() and not ticket.turn.cancelled():  # at the same moment
                self._idle.append(ticket.turn.result())
            self._hand_out()
            raise

    def _hand_out(self) -> None:
        """Give idle workers to those who wait, and tell the others their place."""
        while self._idle and self._waiting:
            ticket = self._waiting.popleft()
            if not ticket.turn.done():
                ticket.turn.set_result(self._idle.pop())
        for place, ticket in enumerate(self._waiting, 1):
            ticket.said(f"waiting for a free process, number {place} in the queue")

    def end(self) -> None:
        """End all processes."""
        for worker in self._all:
            worker.end()


class _Worker:
    """A process that does one job after another."""

    def __init__(self) -> None:
        self._process: Any = None
        self._connection: Connection | None = None
        self._reader = ThreadPoolExecutor(1)

    async def work(
        self, job: Callable[..., Any], arguments: tuple[Any, ...], folder: Path, said: Said
    ) -> Any:
        connection = self._started()
        connection.send((job, arguments, str(folder)))
        while True:
            try:
                kind, content = await asyncio.get_running_loop().run_in_executor(
                    self._reader, connection.recv
                )
            except (EOFError, OSError):
                self.end()
                raise JobError(
                    "the work ended early, perhaps for lack of memory: close other windows, or "
                    "give a shorter log"
                ) from None
            if kind == "done":
                return content
            if kind == "failed":
                raise content
            said(content)

    def _started(self) -> Connection:
        if self._connection is not None and self._process.is_alive():
            return self._connection
        self.end()
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()
        return self._connection

    def end(self) -> None:
        """End the process; the next job starts another."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._process.close()
        if self._connection is not None:  # by the thread that may still read from it
            self._reader.submit(self._connection.close)
        self._process = self._connection = None


def _serve(connection: Connection) -> None:
    """Do jobs as long as the studio is there."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the studio, which ends us
    while True:
        try:
            job, arguments, folder = connection.recv()
        except EOFError:
            return
        try:
            _enter(folder)
            answer = ("done", job(lambda text: connection.send(("said", text)), *arguments))
        except FlexidError as error:
            answer = ("failed", error)
        except MemoryError:
            answer = ("failed", JobError("the memory does not suffice: give a shorter log"))
        except Exception as error:  # an error that nobody foresaw must not end the process
            answer = ("failed", JobError(f"a defect of flexid ({type(error).__name__}: {error})"))
        connection.send(answer)


def _enter(folder: str) -> None:
    """Make a folder that of the process."""
    try:
        os.chdir(folder)
    except OSError as error:
        raise JobError(
            f"the folder of the log cannot be entered ({error.strerror}): choose the log again"
        ) from None
