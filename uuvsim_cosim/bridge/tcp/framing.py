"""Frames of the TCP protocol: two lengths, a JSON header, and float64 numbers.

    bytes 0 to 3    length of the header, unsigned, little-endian
    bytes 4 to 7    length of the payload in bytes, unsigned, little-endian, a multiple of 8
    then            the header: UTF-8 JSON, an object
    then            the payload: float64, little-endian

A column of numbers whose `format` is int64 or uint64 holds these types instead of float64, also in
a request. If a request has `integers`: true, each column of the answer names its format, which is
int64 or uint64 for the types Int64, UInt64 and Enumeration. Without it, an integer that float64
would round is refused.

A frame without a header is a compact step, whose layout an earlier `layout` call has defined: a
request is [n, inputs ...], the answer [tick, time, outputs ...]. The header of an answer always has
`ok`; if that is false, `error` is the message and `kind` the name of the error's class.
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
    """The other end of a connection has closed it, or was too slow."""


def frame(header: Mapping[str, object] | None, payload: bytes = b"") -> bytes:
    """Return the bytes of a frame; without a header (None) it is a compact step."""
    text = "" if header is None else json.dumps(header, ensure_ascii=False)
    return begun(text, len(payload)) + payload


def begun(text: str, payload: int) -> bytes:
    """Return the bytes of a frame up to its payload, which has `payload` bytes."""
    head = text.encode(errors="replace")  # a client may have sent half of a surrogate pair
    return _PREFIX.pack(len(head), payload) + head


class Reader:
    """A reader of frames from a stream of bytes, which never allocates more than has arrived.

    `receive(size, begun)` returns at most `size` bytes. It may wait without limit only if `begun`
    is False.
    """

    def __init__(self, receive: Callable[[int, bool], bytes], limits: Limits) -> None:
        self._receive = receive
        self.limits = limits
        self._buffer = bytearray()

    def frame(self) -> tuple[dict[str, Any] | None, bytes]:
        """Wait for a frame; raises Disconnected at the stream's end, InputInvalid for no frame."""
        if not self._buffer:
            self._more(begun=False)  # waiting for a frame to begin is not bounded
        end = time.monotonic() + self.limits.frame_s
        self._fill(_PREFIX.size, end)
        head, payload = _PREFIX.unpack_from(self._buffer)
        # Refused before its bytes have arrived:
        for what, read, most in (
            ("header", head, self.limits.header_bytes),
            ("payload", payload, self.limits.payload_bytes),
        ):
            if read > most:
                raise InputInvalid(
                    "frame",
                    f"a {what} of {read} bytes was announced",
                    f"at most {most} (a frame begins with two little-endian uint32, see "
                    "docs/connections/protocol.md)",
                )
        if payload % 8:
            raise InputInvalid(
                "frame", f"a payload of {payload} bytes was announced", "a multiple of 8"
            )
        total = _PREFIX.size + head + payload
        self._fill(total, end)
        data = bytes(self._buffer[:total])
        del self._buffer[:total]
        body = data[_PREFIX.size + head :]
        text = data[_PREFIX.size : _PREFIX.size + head]
        return (read_object(text, "frame: its header") if head else None), body

    def _fill(self, size: int, end: float) -> None:
        while len(self._buffer) < size:
            if time.monotonic() > end:
                raise InputInvalid(
                    "frame",
                    f"{len(self._buffer)} of {size} bytes came in {self.limits.frame_s:g} s",
                    "all of them by then",
                )
            self._more(begun=True)

    def _more(self, *, begun: bool) -> None:
        try:
            data = self._receive(_CHUNK, begun)
        except TimeoutError:
            raise InputInvalid(
                "connection", "nothing came within the time limit of a frame", "a whole frame"
            ) from None
        except OSError as error:
            raise Disconnected(str(error)) from None
        if not data:
            raise Disconnected("closed by the other end")
        self._buffer += data
