"""A frame on the TCP door: two lengths, a JSON header, and float64 numbers.

    bytes 0 to 3    length of the header, unsigned, little-endian
    bytes 4 to 7    length of the payload in bytes, unsigned, little-endian, a multiple of 8
    then            the header: UTF-8 JSON, an object
    then            the payload: float64, little-endian

A frame without a header is the compact step, whose layout was agreed on before by a `layout` call:
a request is [n, inputs ...], the answer [tick, time, outputs ...]. A header of an answer always has
`ok`; where it is false, `error` says in words what is wrong and `kind` names the error's class.
"""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["HTTP_PORT", "PROTOCOL", "TCP_PORT", "Disconnected", "Limits", "Reader", "frame"]

PROTOCOL = 1
TCP_PORT = 7448
HTTP_PORT = 7449
_PREFIX = struct.Struct("<II")
_CHUNK = 1 << 16


@dataclass(frozen=True)
class Limits:
    """What one client may take of a door, so that none can slow or stop the others."""

    clients: int = 32
    hello_s: float = 5.0  # a client says who it is within this time, or is let go
    frame_s: float = 10.0  # a frame that has begun ends within this time, in both directions
    header_bytes: int = 1 << 20
    payload_bytes: int = 8 << 20
    answer_bytes: int = 512 << 20
    calls_per_s: float = 5000.0  # of calls that do not step; faster ones are made to wait
    connections_per_s: float = 200.0
    patience_s: float = 1.0  # where all places are taken, who has said nothing for so long goes


class Disconnected(UuvsimError):
    """The other end of a connection has gone, or was too slow."""


def frame(header: Mapping[str, Any] | None, payload: bytes = b"") -> bytes:
    """Give the bytes of a frame; `None` as header makes the compact step's."""
    head = b"" if header is None else json.dumps(header, ensure_ascii=False).encode()
    return _PREFIX.pack(len(head), len(payload)) + head + payload


class Reader:
    """Takes frames from a stream of bytes, and never keeps more than arrived.

    `receive(size, begun)` gives at most so many bytes; `begun` says that it may not wait for ever.
    """

    def __init__(self, receive: Callable[[int, bool], bytes], limits: Limits) -> None:
        self._receive = receive
        self._limits = limits
        self._buffer = bytearray()

    def frame(self) -> tuple[dict[str, Any] | None, bytes]:
        """Wait for a frame; raises Disconnected at its end, InputInvalid for what is no frame."""
        if not self._buffer:
            self._more(begun=False)  # waiting for a frame to begin is not bounded
        end = time.monotonic() + self._limits.frame_s
        self._fill(_PREFIX.size, end)
        head, payload = _PREFIX.unpack_from(self._buffer)
        self._check(head, payload)
        total = _PREFIX.size + head + payload
        self._fill(total, end)
        taken = bytes(self._buffer[:total])
        del self._buffer[:total]
        body = taken[_PREFIX.size + head :]
        return (_header(taken[_PREFIX.size : _PREFIX.size + head]) if head else None), body

    def _check(self, head: int, payload: int) -> None:
        for what, read, most in (
            ("header", head, self._limits.header_bytes),
            ("payload", payload, self._limits.payload_bytes),
        ):
            if read > most:
                raise InputInvalid(
                    f"frame: a {what} of {read} bytes was announced; expected at most {most} "
                    "(a frame begins with two little-endian uint32, see docs/connect_matlab.md)"
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
                    f"{self._limits.frame_s:g} s; expected all of them by then"
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


def _header(data: bytes) -> dict[str, Any]:
    try:
        read = json.loads(data, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise InputInvalid(f"frame: its header is not JSON ({error})") from None
    if not isinstance(read, dict):
        raise InputInvalid(f"frame: its header is a JSON {type(read).__name__}; expected an object")
    return read


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is no JSON")
