"""Jobs shared out to threads."""

import threading
from collections import Counter

import pytest

from flexid.simulation.ensemble import share_out


@pytest.mark.parametrize("workers", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 30])
def test_every_job_is_done_once(workers: int, count: int) -> None:
    """Assert that each place is handed out exactly once."""
    done: list[int] = []
    share_out(count, workers, done.append)
    assert Counter(done) == Counter(range(count))


def test_a_slow_job_holds_up_nobody() -> None:
    """Assert that one thread does all other jobs while another is busy with the first."""
    others = threading.Event()
    done: list[int] = []

    def job(place: int) -> None:
        if place == 0:
            assert others.wait(30.0)
        done.append(place)
        if len(done) == 9:
            others.set()

    share_out(10, 2, job)
    assert done[-1] == 0


@pytest.mark.parametrize("workers", [1, 3])
def test_what_a_job_raises_ends_all(workers: int) -> None:
    """Assert that an error comes out and that no thread goes on to the end."""
    done: list[int] = []
    failed = threading.Event()

    def job(place: int) -> None:
        if place == 3:
            failed.set()
            raise ArithmeticError
        if place > 3:
            failed.wait(30.0)
        done.append(place)

    with pytest.raises(ArithmeticError):
        share_out(100_000, workers, job)
    assert len(done) < 99_999
