"""Reports of crashes and exit() of foreign code in this process, with the component's name.

A component in this process may crash, or call exit(), which would end the program with status 0.
Each call of foreign code is noted, so that one line on standard error names the component and the
function. After an exit(), open files are completed and the exit status is 3, as for a component
that failed. ``_exit()`` cannot be detected: it ends a process without calling any handler.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import os
import sys
from collections.abc import Callable
from functools import lru_cache
from typing import Any, final

from uuvsim_cosim.closing import Closing
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import ComponentFailed
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared

__all__ = [
    "AtComponentExit",
    "Frame",
    "Guarded",
    "calling_component",
    "guard_functions",
    "guard_library",
]

_closers: list[AtComponentExit] = []
_armed_for: list[bool] = []  # whether pyarrow was loaded, at each registration


class Frame(ctypes.Structure):
    """``uuv_frame``: a call of foreign code that has not returned."""

    _fields_ = (
        ("component", ctypes.c_char_p),
        ("verb", ctypes.c_char_p),
        ("noun", ctypes.c_char_p),
        ("outer", ctypes.c_void_p),
    )


@lru_cache
def guard_library() -> ctypes.PyDLL:
    """Load the C side, compiled at first use; from then on crashes and exits are reported."""
    folder = content("fmus", "guard")
    path = compile_shared([folder / "uuv_guard.c"], name="uuv_guard", include=[folder])
    c = ctypes.PyDLL(str(path))  # keeps the interpreter's lock, as its calls are short
    for name in ("enter", "leave"):
        function = getattr(c, f"uuv_guard_{name}")
        function.restype, function.argtypes = None, [ctypes.c_void_p]
    c.uuv_guard_component.restype, c.uuv_guard_component.argtypes = ctypes.c_char_p, []
    c.uuv_guard_on_exit(_ON_EXIT)
    c.uuv_guard_watch()
    _arm(c)
    atexit.register(_python_leaves, c)
    if hasattr(os, "register_at_fork"):  # open files are the parent's, not a forked child's
        os.register_at_fork(after_in_child=_closers.clear)
    return c


def guard_functions() -> tuple[int, int]:
    """Return the addresses of ``uuv_guard_enter`` and ``uuv_guard_leave``."""
    c = guard_library()
    pair = (c.uuv_guard_enter, c.uuv_guard_leave)
    enter, leave = (ctypes.cast(f, ctypes.c_void_p).value or 0 for f in pair)
    return enter, leave


@final
class Guarded:
    """A function of an instance, called within a frame that names both; it is not reentrant."""

    def __init__(self, function: Callable[..., object], component: bytes, name: bytes) -> None:
        c = guard_library()
        self._function = function
        self._enter, self._leave = c.uuv_guard_enter, c.uuv_guard_leave
        self._frame = Frame(component, name, b"", None)
        self._address = ctypes.addressof(self._frame)

    def __call__(self, *arguments: object) -> Any:
        """Call the function."""
        self._enter(self._address)
        try:
            return self._function(*arguments)
        finally:
            self._leave(self._address)


@final
class AtComponentExit(Closing):
    """Registration of a function that is called if a component ends the program."""

    def __init__(self, function: Callable[[], None]) -> None:
        _arm(guard_library())
        self._function = function
        _closers.append(self)

    def call(self) -> None:
        """Call the function."""
        self._function()

    def close(self) -> None:
        """Remove the registration; a second call does nothing."""
        if self in _closers:
            _closers.remove(self)


def calling_component() -> str:
    """Return the path of the component that this thread is calling, else an empty text."""
    return (guard_library().uuv_guard_component() or b"").decode(errors="replace")


def _arm(c: ctypes.PyDLL) -> None:
    """Register the handler of exit(), again once pyarrow is loaded, to run before pyarrow's."""
    loaded = "pyarrow" in sys.modules
    if loaded not in _armed_for:
        _armed_for.append(loaded)
        c.uuv_guard_arm()


def _close_all() -> None:
    for close in reversed(_closers):
        try:
            close.call()
        except BaseException as error:  # no error may stop the process from ending
            sys.stderr.write(f"uuvsim: {error}\n")
    with contextlib.suppress(Exception):
        sys.stdout.flush()
        sys.stderr.flush()


def _python_leaves(c: ctypes.PyDLL) -> None:
    """Distinguish the normal end of Python from one that a component causes."""
    nested = sys._getframe(0).f_back is not None  # at a normal end, there is no caller
    if nested and c.uuv_guard_component() is not None and c.uuv_guard_report():
        _close_all()
        os._exit(ComponentFailed.exit_status)
    c.uuv_guard_leaving()


_ON_EXIT = ctypes.CFUNCTYPE(None)(_close_all)
