"""Pieces of work shared among threads."""

from __future__ import annotations

import threading

import pytest

from uuvsim_cosim.share import compute_in_threads, share


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_every_piece_comes_once_with_its_result(threads: int) -> None:
    squares = dict(compute_in_threads(lambda n: n * n, range(40), threads))
    assert squares == {n: n * n for n in range(40)}


def test_no_piece_gives_nothing() -> None:
    assert list(compute_in_threads(str, [], 3)) == []


@pytest.mark.parametrize("threads", [1, 3])
def test_the_first_error_ends_the_work_and_no_thread_goes_on(threads: int) -> None:
    at_work: set[int] = set()

    def work(n: int) -> int:
        at_work.add(n)
        if n == 5:
            at_work.remove(n)
            raise ZeroDivisionError(n)
        at_work.remove(n)
        return n

    with pytest.raises(ZeroDivisionError):
        list(compute_in_threads(work, range(1000), threads))
    assert not at_work
    assert all(not t.name.endswith("(go_on)") for t in threading.enumerate())


def test_a_caller_that_leaves_ends_the_work() -> None:
    done: list[int] = []

    def work(n: int) -> None:
        done.append(sum(range(100_000)))

    for _ in compute_in_threads(work, range(5000), 2):
        break
    number = len(done)
    assert number < 5000
    assert not [t for t in threading.enumerate() if t.name.endswith("(go_on)")]
    assert len(done) == number


def test_each_worker_does_its_own_pieces() -> None:
    results = list(share(lambda worker, piece: (worker, piece), ["a", "b"], range(20)))
    assert sorted(piece for _, piece in results) == list(range(20))
    assert {worker for worker, _ in results} <= {"a", "b"}
