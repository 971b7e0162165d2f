"""A client of the TCP endpoint in a few lines, to say right and wrong things to it."""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Mapping
from typing import Any, Self

import numpy as np

from uuvsim_cosim.bridge.access.token import known_token
from uuvsim_cosim.bridge.tcp.framing import frame


def bearer(port: int) -> dict[str, str]:
    """Return the header with the token of this user's server, if it asks for one."""
    token = known_token("127.0.0.1", port)
    return {} if token is None else {"Authorization": f"Bearer {token}"}


class Peer:
    """One connection; `ask` sends a frame and gives the answer's header and numbers."""

    def __init__(self, port: int, host: str = "127.0.0.1", **hello: Any) -> None:
        self.socket = socket.create_connection((host, port))
        self.greeting, _ = self.answer()
        self.welcome: Mapping[str, Any] = {}
        if hello.get("call", "hello") is not None:
            token = known_token("127.0.0.1", port)
            said = {"call": "hello", "protocol": 1, "name": "peer", "token": token, **hello}
            self.welcome, _ = self.ask(said)

    def ask(
        self, header: Mapping[str, Any] | None, numbers: Any = ()
    ) -> tuple[Mapping[str, Any], np.ndarray]:
        self.socket.sendall(frame(header, np.asarray(numbers, dtype="<f8").tobytes()))
        return self.answer()

    def answer(self) -> tuple[Mapping[str, Any], np.ndarray]:
        head, body = struct.unpack("<II", self.exactly(8))
        header = json.loads(self.exactly(head)) if head else {}
        return header, np.frombuffer(self.exactly(body), dtype="<f8")

    @staticmethod
    def bits(data: bytes) -> np.ndarray:
        """Return bytes as the numbers that `ask` sends."""
        return np.frombuffer(data, dtype="<f8")

    def exactly(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            more = self.socket.recv(count - len(data))
            if not more:
                raise EOFError
            data += more
        return data

    def ended(self) -> bool:
        """Tell whether the other end has closed."""
        try:
            return not self.socket.recv(1 << 16)
        except ConnectionResetError:
            return True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()
