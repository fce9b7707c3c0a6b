"""Many independent jobs on several threads, each job to whoever is free."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from threading import Lock


def share_out(count: int, workers: int, job: Callable[[int], None]) -> None:
    """Call ``job(0)`` … ``job(count - 1)``, several at a time.

    Threads are enough, because compiled code lets other threads run. What a job raises ends all
    of them, each after the job at hand, and is raised here; so does an interrupt.
    """
    if workers == 1:
        for place in range(count):
            job(place)
        return
    places = iter(range(count))
    lock = Lock()
    stopped = False

    def serve() -> None:
        while not stopped:
            with lock:
                place = next(places, None)
            if place is None:
                return
            job(place)

    with ThreadPoolExecutor(min(workers, max(count, 1))) as pool:
        try:
            for served in [pool.submit(serve) for _ in range(min(workers, count))]:
                served.result()
        finally:
            stopped = True
