"""Ctrl-C while CasADi works: its Python part suppresses every exception at some places."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["interruptible"]


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise the exception of Ctrl-C at the end of the block if it was suppressed inside.

    Use it as a decorator too. It does nothing outside the main thread, which alone gets signals.

    Example:

    >>> import signal
    >>> from uuvsim_cosim.models.declaration.interruption import interruptible
    >>> try:
    ...     with interruptible():
    ...         try:
    ...             signal.raise_signal(signal.SIGINT)
    ...         except BaseException:
    ...             pass
    ... except KeyboardInterrupt:
    ...     print("interrupted")
    interrupted
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    raised: list[BaseException] = []

    def noticed(number: int, frame: FrameType | None) -> None:
        try:
            before(number, frame)
        except BaseException as error:
            raised.append(error)
            raise

    signal.signal(signal.SIGINT, noticed)
    try:
        yield
    except Exception:
        if not raised:
            raise
    finally:
        signal.signal(signal.SIGINT, before)
    if raised:
        raise raised[0]
