"""Session of one TCP client: it authenticates, then each frame that it sends is answered by one."""

from __future__ import annotations

import json
import socket
import struct
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np

from uuvsim_cosim._version import __version__
from uuvsim_cosim.bridge.access.authentication import Admission
from uuvsim_cosim.bridge.access.tls import common_name
from uuvsim_cosim.bridge.calls.call_table import CALLS, checked, whole
from uuvsim_cosim.bridge.calls.connection_limits import ConnectionSlots, Limits
from uuvsim_cosim.bridge.calls.service import Client, Service, SignalInfo, entry, interface_hash
from uuvsim_cosim.bridge.calls.time_sharing import READS, RateLimit, share_of
from uuvsim_cosim.bridge.calls.values import (
    columns_of,
    find,
    format_of,
    json_of,
    numbers_of,
    pieces,
    shaped,
    shown,
    unpacked,
)
from uuvsim_cosim.bridge.tcp.framing import PROTOCOL, Disconnected, Reader, begun, frame
from uuvsim_cosim.bridge.tcp.requests import Calls, failure
from uuvsim_cosim.errors import InputInvalid

__all__ = ["Session", "full"]

_PIECE = 1 << 20  # bytes that are sent at once
_SMALL = 1 << 16  # bytes of numbers that are sent at once with their header
_HELLO = ("call", "protocol", "user", "password", "token")  # in addition to the fields of `join`


class _Layout:
    """Offset and format of each input and output in the payload of a compact step."""

    def __init__(self, calls: Calls, request: Mapping[str, object]) -> None:
        for field in request:
            if field not in ("call", "inputs", "outputs", "integers"):
                raise InputInvalid(
                    "layout", f"field {field!r} does not exist", "some of inputs, outputs, integers"
                )
        self._exact = _integers(request)
        self.inputs = [find(calls.schema, n) for n in _list(request, "inputs")]
        self.outputs = [find(calls.schema, n) for n in _list(request, "outputs")]
        for info in (*self.inputs, *self.outputs):
            if info.type in ("String", "Binary"):
                raise InputInvalid("layout", f"{info.name} is a {info.type}", "numbers")
        sizes = [int(np.prod(info.shape, dtype=int)) for info in self.inputs]
        self.ends = np.cumsum([1, *sizes]).tolist()
        self.names = [info.name for info in self.outputs]
        self.formats = [self._format(info) for info in self.inputs]

    def _format(self, info: SignalInfo) -> str:
        return (format_of(info.type) if self._exact else None) or "float64"

    def header(self) -> dict[str, object]:
        interface = interface_hash(self.inputs, self.outputs)
        return {
            "inputs": [self._entry(i) for i in self.inputs],
            "outputs": [self._entry(i) for i in self.outputs],
            "interface": interface,
        }

    def _entry(self, info: SignalInfo) -> dict[str, object]:
        return {**entry(info), **({"format": self._format(info)} if self._exact else {})}

    def outputs_of(self, found: Mapping[str, object], schema: Mapping[str, SignalInfo]) -> bytes:
        """Return the numbers of all outputs; a layout may contain an output twice."""
        arrays = columns_of(found, schema, integers=self._exact)[2]
        parts = dict(zip(found, map(numbers_of, arrays), strict=True))
        return b"".join(parts[name] for name in self.names)


class Session:
    """One client at a socket, with time limits for its authentication and for each frame."""

    def __init__(
        self,
        service: Service,
        admit: Admission,
        limits: Limits,
        slots: ConnectionSlots,
        connection: socket.socket,
    ) -> None:
        self._service, self._admit, self._limits = service, admit, limits
        self._slots, self._connection = slots, connection
        self._deadline: float | None = time.monotonic() + limits.hello_s  # of the authentication
        least = limits.unknown_bytes
        self._reader = Reader(self._receive, replace(limits, header_bytes=least, payload_bytes=0))

    def serve(self) -> None:
        """Answer the client until it leaves; raises Disconnected if it disconnects before.

        Raises InputInvalid for data that is no frame, and for a client that is refused.
        """
        service, moment = self._service, self._service.moment()
        greeting = {"uuvsim": __version__, "protocol": PROTOCOL, "tick": moment.tick}
        self._send(frame({"ok": True, **greeting, "time": moment.time}))
        client = self._joined()
        try:
            calls = Calls(service, client)
            calls.attended(self._connection)
            allowed = sorted(client.allowed)
            header = {"client": client.name, "allowed": allowed, "step_size": float(calls.tick)}
            self._send(frame({"ok": True, **header, "system": json_of(service.describe())}))
            self._answer_all(calls)
        except (Disconnected, OSError):  # without `bye`: in lockstep the fail-safe decides
            service.lost(client)
            raise
        except BaseException:
            service.leave(client)
            raise
        service.leave(client)
        # Only after `leave`: once its `bye` is answered, no other client waits for this one.
        self._send(frame({"ok": True}))

    def _receive(self, size: int, begun: bool) -> bytes:
        if self._deadline is not None:  # a client that sends byte by byte gets no more time
            self._connection.settimeout(max(self._deadline - time.monotonic(), 0.001))
        else:
            self._connection.settimeout(self._limits.frame_s if begun else None)
        return self._connection.recv(size)

    def _send(self, data: bytes) -> None:
        self._connection.settimeout(self._limits.frame_s)  # one that does not read is disconnected
        for begin in range(0, len(data), _PIECE):
            self._connection.sendall(data[begin : begin + _PIECE] if len(data) > _PIECE else data)

    def _joined(self) -> Client:
        """Authenticate the client by its first frame, and let it join."""
        header, _ = self._reader.frame()
        if header is None or header.get("call") != "hello":
            raise InputInvalid('the first frame must be {"call": "hello", "protocol": 1}')
        if header.get("protocol") != PROTOCOL:
            raise InputInvalid(
                f"protocol {header.get('protocol')!r} was read; this is uuvsim-cosim "
                f"{__version__}, protocol {PROTOCOL}: use the client that `uuvsim matlab` of this "
                "version prints"
            )
        user, password, token = (header.get(k) or None for k in ("user", "password", "token"))
        for what, read in (("user", user), ("password", password), ("token", token)):
            if read is not None and not isinstance(read, str):
                raise InputInvalid(f"hello: {what} must be a text")
        allowed = self._admit(user, password, common_name(self._connection), token)
        self._deadline = None
        if not self._slots.admit(self._connection):
            raise full(self._limits)
        fields = checked("join", {k: v for k, v in header.items() if k not in _HELLO})
        wanted = Client(fields.get("name", "matlab"), "tcp", allowed, self._limits.answer_bytes)
        lockstep, lag = fields.get("lockstep", False), fields.get("lag", 5.0)
        client = self._service.join(wanted, lockstep=lockstep, lag=lag)
        self._reader.limits = self._limits
        return client

    def _answer_all(self, calls: Calls) -> None:
        """Answer frames until the client sends `bye`."""
        layout: _Layout | None = None
        pace, share, mark = (
            RateLimit(self._limits.calls_per_s),
            share_of(calls.service),
            time.thread_time(),
        )
        while True:
            header, payload = self._reader.frame()
            name = "step" if header is None else header.get("call")
            if name != "step":
                pace.wait()  # steps have no limit of their rate; all other calls do
            reads = isinstance(name, str) and name in READS
            if reads:
                share.wait(calls.client, share.turn(calls.client))
            try:
                if header is None:
                    data: Iterable[bytes] = (_compact(calls, layout, payload),)
                elif header.get("call") == "layout":
                    layout = calls.knowing(partial(_Layout, calls, header))
                    data = (frame({"ok": True, **layout.header()}),)
                elif header.get("call") == "bye":
                    return
                else:
                    if header.get("call") == "replace":
                        layout = None  # its variables may no longer exist
                    data = _called(calls, header, payload)
            except Disconnected:
                raise
            except Exception as error:  # also an internal error: it must not end the server
                data = (frame(failure(error)),)
            for part in data:
                self._send(part)
            before, mark = mark, time.thread_time()
            if reads:
                share.took(calls.client, mark - before)


def full(limits: Limits) -> InputInvalid:
    """Return the error for a client beyond the limit."""
    return InputInvalid(f"{limits.clients} clients are connected, the maximum; close one")


def _request(calls: Calls, header: Mapping[str, object], payload: bytes) -> dict[str, object]:
    """Return the fields of a call; `columns` and `values` become its field that holds values."""
    name = header.get("call")
    request = {k: v for k, v in header.items() if k not in ("call", "columns", "integers")}
    if "columns" not in header:
        if payload:
            raise InputInvalid(f"payload of {len(payload)} bytes without columns that name it")
        columns = {}
    else:
        columns = unpacked(header["columns"], payload, calls.schema)
    call = CALLS.get(name) if isinstance(name, str) else None
    if call is None or call.values is None:
        if call is not None and (columns or "values" in request):
            raise InputInvalid(f"{name}: values were given; only set, step and reset take them")
        return request
    if "values" in request and call.values in request and call.values != "values":
        raise InputInvalid(name, f"both values and {call.values} were given", "one")
    given = request.pop("values", None) if "values" in request else request.pop(call.values, None)
    if isinstance(given, dict) and (both := columns.keys() & given.keys()):
        raise InputInvalid(name, f"{', '.join(sorted(both))} is given twice", "it once")
    if columns and (given is None or isinstance(given, dict)):
        given = {**columns, **(given or {})}
    elif given is None and "columns" in header:
        given = {}
    return {**request, call.values: given}


def _called(calls: Calls, header: Mapping[str, object], payload: bytes) -> Iterable[bytes]:
    """Carry out a call; return the bytes of its answer, a large one in pieces."""
    integers = _integers(header)
    request = calls.knowing(lambda: _request(calls, header, payload))
    answer = calls.answer(header.get("call"), request)
    columns, texts, arrays = columns_of(answer.values, calls.schema, integers=integers)
    described = json.dumps({"columns": columns, "texts": texts}, ensure_ascii=False)
    size = sum(8 * array.size for array in arrays)
    first = begun(f"{answer.header_text}, {described[1:]}", size)
    if size < _SMALL:
        return (b"".join((first, *map(numbers_of, arrays))),)
    return chain((first,), (numbers_of(piece) for array in arrays for piece in pieces(array)))


def _integers(header: Mapping[str, object]) -> bool:
    read = header.get("integers", False)
    if not isinstance(read, bool):
        raise InputInvalid("integers", f"{shown(read)} was read", "true or false")
    return read


def _compact(calls: Calls, layout: _Layout | None, payload: bytes) -> bytes:
    """Carry out a compact step; return the bytes of its answer."""
    if layout is None:
        raise InputInvalid("a frame without header is a compact step; ask for a layout first")
    count = len(payload) // 8
    if count != layout.ends[-1]:
        raise InputInvalid(
            f"step: {count - 1} input numbers were read; the layout has "
            f"{layout.ends[-1] - 1}: {', '.join(i.name for i in layout.inputs) or 'none'}"
        )
    (n,) = struct.unpack_from("<d", payload)
    try:
        steps = whole(n)
    except (ValueError, OverflowError):
        raise InputInvalid(
            "step", f"n = {n:g} was read", "a whole number of steps from 1"
        ) from None
    inputs = {
        info.name: shaped(info, np.frombuffer(payload, format_, end - begin, 8 * begin))
        for info, format_, begin, end in zip(
            layout.inputs, layout.formats, layout.ends, layout.ends[1:], strict=False
        )
    }
    moment, found = calls.waited("step", steps, inputs, layout.names)
    at = struct.pack("<dd", moment.tick, moment.time)
    return frame(None, at + layout.outputs_of(found, calls.schema))


def _list(request: Mapping[str, object], field: str) -> list[str]:
    read = request.get(field, [])
    read = [read] if isinstance(read, str) else read
    if not isinstance(read, list) or not all(isinstance(n, str) for n in read):
        raise InputInvalid(field, f"{read!r} was read", "a list of names")
    return read
