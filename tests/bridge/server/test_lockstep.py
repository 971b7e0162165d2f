"""The barrier: who is waited for, for how long, and in which order requests count."""

from __future__ import annotations

from concurrent.futures import Future

from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.server.lockstep import Barrier, Request

A, B = Client("a", "local"), Client("b", "local")


def request(n: int = 1) -> Request:
    return Request(n, (), frozenset(), (), Future())


def held() -> Barrier:
    barrier = Barrier()
    barrier.hold(B, lag=2.0)
    barrier.hold(A, lag=1.0)
    return barrier


def test_a_barrier_that_nobody_holds_is_never_ready() -> None:
    assert not Barrier().is_ready


def test_all_holders_must_have_asked() -> None:
    barrier = held()
    barrier.ask("a", request(), now=0.0)
    assert not barrier.is_ready
    barrier.ask("b", request(), now=0.0)
    assert barrier.is_ready


def test_requests_count_in_the_order_of_names_whoever_came_first() -> None:
    barrier = held()
    barrier.ask("b", request(), now=0.0)
    barrier.ask("a", request(), now=0.1)
    assert [name for name, _ in barrier.asked()] == ["a", "b"]


def test_who_asked_for_more_waits_on() -> None:
    barrier = held()
    barrier.ask("a", request(3), now=0.0)
    barrier.ask("b", request(1), now=0.0)
    assert [name for name, _ in barrier.made(1, now=0.0)] == ["b"]
    assert [r.n for _, r in barrier.asked()] == [2]


def test_nobody_is_late_before_somebody_waits() -> None:
    assert held().deadline() is None
    assert held().late(now=1e9) == []


def test_a_holder_is_late_after_its_own_lag_budget() -> None:
    barrier = held()
    barrier.ask("b", request(), now=10.0)
    assert barrier.deadline() == 11.0
    assert barrier.late(now=10.9) == []
    assert [h.client.name for h in barrier.late(now=11.0)] == ["a"]


def test_the_barrier_waits_for_the_least_patient_of_those_that_are_missing() -> None:
    barrier = held()
    barrier.hold(Client("c", "local"), lag=3600.0)
    barrier.ask("c", request(), now=10.0)
    assert barrier.deadline() == 11.0  # a waits 1 s, b 2 s
    assert [h.client.name for h in barrier.late(now=11.5)] == ["a"]
    barrier.release("a")
    assert barrier.deadline() == 12.0
    assert [h.client.name for h in barrier.late(now=12.0)] == ["b"]


def test_the_wait_begins_anew_with_each_round() -> None:
    barrier = held()
    barrier.ask("a", request(2), now=0.0)
    barrier.ask("b", request(1), now=5.0)
    barrier.made(1, now=5.0)
    assert barrier.deadline() == 7.0


def test_one_that_is_behind_is_not_waited_for_until_it_asks_again() -> None:
    barrier = held()
    barrier.holders["a"].behind = True
    barrier.ask("b", request(), now=0.0)
    assert barrier.is_ready
    barrier.made(1, now=0.0)
    barrier.ask("a", request(), now=0.0)
    assert not barrier.is_ready


def test_the_others_are_ready_once_the_missing_one_is_released() -> None:
    barrier = held()
    barrier.ask("b", request(), now=0.0)
    barrier.release("a")
    assert barrier.is_ready
