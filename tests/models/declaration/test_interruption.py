"""Ctrl-C is not lost while a declaration is made."""

from __future__ import annotations

import contextlib
import signal
from pathlib import Path
from types import FrameType

import pytest

from uuvsim_cosim.models.declaration import files_read
from uuvsim_cosim.models.declaration.interruption import interruptible


def pressed_and_suppressed() -> None:
    """Get Ctrl-C where every exception is suppressed, as in CasADi."""
    with contextlib.suppress(BaseException):
        signal.raise_signal(signal.SIGINT)


def test_a_suppressed_interruption_is_raised_at_the_end_of_the_block() -> None:
    done = []

    @interruptible()
    @interruptible()
    def work() -> None:
        pressed_and_suppressed()
        done.append("rest of the block")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_interruption_comes_before_an_error_that_it_causes() -> None:
    @interruptible()
    def work() -> None:
        pressed_and_suppressed()
        raise NotImplementedError("wrong number or type of arguments")

    with pytest.raises(KeyboardInterrupt):
        work()


def test_errors_without_an_interruption_are_as_before() -> None:
    with pytest.raises(NotImplementedError), interruptible():
        raise NotImplementedError


def test_the_exception_of_another_handler_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    def other(number: int, frame: FrameType | None) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGINT, other)
    try:
        with pytest.raises(TimeoutError), interruptible():
            pressed_and_suppressed()
        assert signal.getsignal(signal.SIGINT) is other
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_result_during_which_ctrl_c_was_suppressed_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UUVSIM_CACHE", str(tmp_path))
    monkeypatch.setattr(files_read, "_program", lambda: "this one")
    disturbed = [True]

    @files_read.kept_until_changed
    def made(text: str) -> str:
        if disturbed:
            pressed_and_suppressed()
            return "wrong"
        return text

    with pytest.raises(KeyboardInterrupt):
        made("right")
    assert not list(tmp_path.rglob("*.pickle"))
    disturbed.clear()
    assert made("right") == "right"
