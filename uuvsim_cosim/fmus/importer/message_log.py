"""The messages of one FMU instance: C writes them from any thread, Python fetches them."""

from __future__ import annotations

import ctypes
import logging
import re
from collections.abc import Callable
from functools import lru_cache

from uuvsim_cosim.content import content
from uuvsim_cosim.fmus.codegen.toolchain import Signatures, compile_shared, load_library

__all__ = ["STATUS", "MessageLog", "logger_library"]

STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
_LEVEL = {"ok": logging.INFO, "note": logging.INFO, "warning": logging.WARNING}
_KEPT = 10_000
_VARIABLE = re.compile(r"#([ribs])(\d+)#")


@lru_cache
def logger_library() -> ctypes.CDLL:
    """Load the C side of the log; compiled at first use."""
    source = content("fmus", "runtime", "fmi", "uuv_logger.c")
    pointer = ctypes.c_void_p
    signatures: Signatures = {
        "uuv_log_new": (pointer, []),
        "uuv_log_free": (None, [pointer]),
        "uuv_log_name": (None, [pointer, ctypes.c_char_p, pointer]),
        "uuv_log_take": (ctypes.c_int32, [pointer] * 4),
        "uuv_log_lost": (ctypes.c_uint64, [pointer]),
        "uuv_release": (None, [pointer]),
    }
    return load_library(compile_shared([source], name="uuv_logger"), signatures)


class MessageLog:
    """The log of one instance; `environment` is the pointer for its callbacks."""

    def __init__(self, path: str, variable_named: Callable[[str, int], str | None]) -> None:
        self.kept: list[tuple[str, str]] = []  # (status, text); "note" is this program's
        self._c = logger_library()
        self._variable_named = variable_named
        self._logger = logging.getLogger(f"uuvsim_cosim.{path}")
        self.environment: int = self._c.uuv_log_new()
        self._count = ctypes.c_uint32.from_address(self.environment)

    def address(self, callback: str) -> int:
        """Return the address of a callback of the C side, such as ``uuv_log_fmi2``."""
        return ctypes.cast(getattr(self._c, callback), ctypes.c_void_p).value or 0

    def name(self, path: str, component: int | None = None) -> None:
        """Set the name and the address of the instance, which FMI 1.0 gives to its logger."""
        self._c.uuv_log_name(self.environment, path.encode(), component)

    def drain(self) -> int:
        """Fetch the messages that have been written; return their number."""
        if not self.environment or not self._count.value:
            return 0
        count = 0
        status, category, text = ctypes.c_int32(), ctypes.c_void_p(), ctypes.c_void_p()
        pointers = [ctypes.byref(x) for x in (status, category, text)]
        while self._c.uuv_log_take(self.environment, *pointers):
            try:
                name = STATUS[status.value] if 0 <= status.value < len(STATUS) else "ok"
                self._keep(name, _string(category), _string(text))
            finally:
                self._c.uuv_release(category)
                self._c.uuv_release(text)
            count += 1
        lost = self._c.uuv_log_lost(self.environment)
        if lost:
            self._keep("warning", "", f"{lost} earlier messages were lost")
        return count

    def free(self) -> None:
        """Fetch the last messages and free the C side; a second call does nothing."""
        if self.environment:
            self.drain()
            self._c.uuv_log_free(self.environment)
            self.environment = 0

    def remark(self, text: str) -> None:
        """Add a note of this program, with the status ``note``."""
        self._keep("note", "", text)

    def last(self, count: int) -> str:
        """Return the last three of `count` messages, preferably warnings and errors.

        If `count` is 0, all warnings and errors count.
        """
        recent = (
            self.kept[-count:] if count else [m for m in self.kept if m[0] not in ("ok", "note")]
        )
        texts = [text for _, text in recent]
        severe = [text for status, text in recent if status != "ok"]
        return "; ".join(" ".join(text.split()) for text in (severe or texts)[-3:])

    def _keep(self, status: str, category: str, text: str) -> None:
        """Store a message, with variables' names instead of references such as ``#r5#``.

        FMI 1.0 and 2.0 have such references.
        """

        def name(match: re.Match[str]) -> str:
            return self._variable_named(match[1], int(match[2])) or match[0]

        text = _VARIABLE.sub(name, text).replace("##", "#").strip()
        self.kept.append((status, text))
        if len(self.kept) > _KEPT:
            del self.kept[: _KEPT // 2]
        level = _LEVEL.get(status, logging.ERROR)
        self._logger.log(level, "%s%s", f"[{category}] " if category else "", text)


def _string(pointer: ctypes.c_void_p) -> str:
    return ctypes.string_at(pointer).decode(errors="replace") if pointer.value else ""
