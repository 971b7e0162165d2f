"""A frame on the TCP server: two lengths, a JSON header, and float64 numbers.

    bytes 0 to 3    length of the header, unsigned, little-endian
    bytes 4 to 7    length of the payload in bytes, unsigned, little-endian, a multiple of 8
    then            the header: UTF-8 JSON, an object
    then            the payload: float64, little-endian

A column of numbers whose `format` is int64 or uint64 holds these in place of float64. A request
may give columns so. Where a request has `integers`: true, each column of the answer names its
format, which is int64 or uint64 for the types Int64, UInt64 and Enumeration. Without it, an
integer that float64 would round is refused.

A frame without a header is the compact step, whose layout was agreed on before by a `layout` call:
a request is [n, inputs ...], the answer [tick, time, outputs ...]. A header of an answer always has
`ok`; where it is false, `error` says in words what is wrong and `kind` names the error's class.
"""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Callable, Mapping
from typing import Any

from uuvsim_cosim.bridge.calls.call_table import read_object
from uuvsim_cosim.bridge.calls.connection_limits import Limits
from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = [
    "HTTP_PORT",
    "PROTOCOL",
    "TCP_PORT",
    "Disconnected",
    "Reader",
    "begun",
    "frame",
]

PROTOCOL = 1
TCP_PORT = 7448
HTTP_PORT = 7449
_PREFIX = struct.Struct("<II")
_CHUNK = 1 << 16


class Disconnected(UuvsimError):
    """The other end of a connection has gone, or was too slow."""


def frame(header: Mapping[str, Any] | None, payload: bytes = b"") -> bytes:
    """Return the bytes of a frame; `None` as header makes the compact step's."""
    text = "" if header is None else json.dumps(header, ensure_ascii=False)
    return begun(text, len(payload)) + payload


def begun(text: str, payload: int) -> bytes:
    """Return the bytes of a frame up to its payload, of which so many bytes follow."""
    head = text.encode(errors="replace")  # half of a surrogate pair that a client sent
    return _PREFIX.pack(len(head), payload) + head


class Reader:
    """Takes frames from a stream of bytes, and never keeps more than arrived.

    `receive(size, begun)` gives at most so many bytes; `begun` says that it may not wait for ever.
    """

    def __init__(self, receive: Callable[[int, bool], bytes], limits: Limits) -> None:
        self._receive = receive
        self.limits = limits
        self._buffer = bytearray()

    def frame(self) -> tuple[dict[str, Any] | None, bytes]:
        """Wait for a frame; raises Disconnected at its end, InputInvalid for what is no frame."""
        if not self._buffer:
            self._more(begun=False)  # waiting for a frame to begin is not bounded
        end = time.monotonic() + self.limits.frame_s
        self._fill(_PREFIX.size, end)
        head, payload = _PREFIX.unpack_from(self._buffer)
        self._check(head, payload)
        total = _PREFIX.size + head + payload
        self._fill(total, end)
        taken = bytes(self._buffer[:total])
        del self._buffer[:total]
        body = taken[_PREFIX.size + head :]
        said = taken[_PREFIX.size : _PREFIX.size + head]
        return (read_object(said, "frame: its header") if head else None), body

    def _check(self, head: int, payload: int) -> None:
        for what, read, most in (
            ("header", head, self.limits.header_bytes),
            ("payload", payload, self.limits.payload_bytes),
        ):
            if read > most:
                raise InputInvalid(
                    f"frame: a {what} of {read} bytes was announced; expected at most {most} "
                    "(a frame begins with two little-endian uint32, see "
                    "docs/connections/connect_matlab.md)"
                )
        if payload % 8:
            raise InputInvalid(
                f"frame: a payload of {payload} bytes was announced; expected a multiple of 8"
            )

    def _fill(self, size: int, end: float) -> None:
        while len(self._buffer) < size:
            if time.monotonic() > end:
                raise InputInvalid(
                    f"frame: {len(self._buffer)} of {size} bytes came in "
                    f"{self.limits.frame_s:g} s; expected all of them by then"
                )
            self._more(begun=True)

    def _more(self, *, begun: bool) -> None:
        try:
            data = self._receive(_CHUNK, begun)
        except TimeoutError:
            raise InputInvalid(
                "connection: nothing came within the time that a frame has; expected a whole frame"
            ) from None
        except OSError as error:
            raise Disconnected(str(error)) from None
        if not data:
            raise Disconnected("closed by the other end")
        self._buffer += data
