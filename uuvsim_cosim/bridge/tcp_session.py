"""One client on the TCP door: it says who it is, then each frame it sends is answered by one."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from uuvsim_cosim._version import __version__
from uuvsim_cosim.bridge.access_doorkeeper import Admission, everybody
from uuvsim_cosim.bridge.desk import Client, Desk
from uuvsim_cosim.bridge.interface import entry, interface_hash
from uuvsim_cosim.bridge.wire import PROTOCOL, Disconnected, Limits, Reader, frame
from uuvsim_cosim.bridge.wire_calls import Answer, Calls, failure, whole
from uuvsim_cosim.bridge.wire_values import columns_of, find, json_of, taken, typed, unpacked
from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["Admission", "everybody", "serve"]


class _Layout:
    """Where each input and output of the compact step lies."""

    def __init__(self, calls: Calls, request: Mapping[str, Any]) -> None:
        self.inputs = [find(calls.schema, n) for n in _list(request, "inputs")]
        self.outputs = [find(calls.schema, n) for n in _list(request, "outputs")]
        for info in (*self.inputs, *self.outputs):
            if info.type in ("String", "Binary"):
                raise InputInvalid(f"layout: {info.name} is a {info.type}; expected numbers")
        sizes = [int(np.prod(info.shape, dtype=int)) for info in self.inputs]
        self.ends = np.cumsum([1, *sizes]).tolist()
        self.names = [info.name for info in self.outputs]

    def header(self) -> dict[str, Any]:
        def shown(infos: list[Any]) -> list[dict[str, Any]]:
            return [dict(entry(i)) for i in infos]

        interface = interface_hash(self.inputs, self.outputs)
        return {
            "inputs": shown(self.inputs),
            "outputs": shown(self.outputs),
            "interface": interface,
        }


def serve(
    desk: Desk,
    admit: Admission,
    limits: Limits,
    receive: Callable[[int, bool], bytes],
    send: Callable[[bytes], None],
    admitted: Callable[[], None],
    certificate: str | None = None,
    gone: Callable[[], bool] = lambda: False,
) -> None:
    """Answer one client until it goes; raises Disconnected then, InputInvalid for no frame."""
    moment = desk.moment()
    greeting = {"uuvsim": __version__, "protocol": PROTOCOL, "tick": moment.tick}
    send(frame({"ok": True, **greeting, "time": moment.time}))
    reader = Reader(receive, limits)
    client = _hello(desk, admit, reader, certificate)
    admitted()
    try:
        calls = Calls(desk, client)
        calls.attended(gone)
        allowed = sorted(client.allowed)
        header = {"client": client.name, "allowed": allowed, "step_size": float(calls.tick)}
        send(frame({"ok": True, **header, "system": json_of(desk.describe())}))
        _answer_all(calls, reader, send, limits)
    except (Disconnected, OSError):  # gone without a word: in lockstep the fail-safe decides
        getattr(desk, "lost", desk.leave)(client)
        raise
    except BaseException:
        desk.leave(client)
        raise
    desk.leave(client)
    send(frame({"ok": True}))  # after it: who has said bye, and was answered, holds nobody up


def _hello(desk: Desk, admit: Admission, reader: Reader, certificate: str | None) -> Client:
    header, _ = reader.frame()
    if header is None or header.get("call") != "hello":
        raise InputInvalid('the first frame must be {"call": "hello", "protocol": 1}')
    if header.get("protocol") != PROTOCOL:
        raise InputInvalid(
            f"protocol {header.get('protocol')!r} was read; this is uuvsim-cosim {__version__}, "
            f"protocol {PROTOCOL}: use the client that `uuvsim matlab` of this version names"
        )
    user, password = (header.get(k) or None for k in ("user", "password"))
    for what, read in (("user", user), ("password", password)):
        if read is not None and not isinstance(read, str):
            raise InputInvalid(f"hello: {what} must be a text")
    shown = () if certificate is None else (certificate,)
    allowed = admit(user, password, *shown)
    lockstep, lag = header.get("lockstep", False), header.get("lag", 5.0)
    if not isinstance(lag, int | float) or not 0 < lag <= 3600:
        raise InputInvalid(
            f"hello: lag = {lag!r} was read; expected seconds, above 0, at most 3600"
        )
    name = str(header.get("name") or "matlab")[:64]
    return desk.join(Client(name, "tcp", allowed), lockstep=lockstep in (True, 1), lag=float(lag))


def _answer_all(
    calls: Calls, reader: Reader, send: Callable[[bytes], None], limits: Limits
) -> None:
    layout: _Layout | None = None
    allowance, last = limits.calls_per_s, time.monotonic()
    while True:
        header, payload = reader.frame()
        if header is None or header.get("call") == "step":
            pass  # who steps sets the pace; all other calls have a rate
        else:
            now = time.monotonic()
            allowance = min(allowance + (now - last) * limits.calls_per_s, limits.calls_per_s) - 1
            last = now
            if allowance < 0:
                time.sleep(-allowance / limits.calls_per_s)
        try:
            if header is None:
                data = _compact(calls, layout, payload)
            elif header.get("call") == "layout":
                layout = calls.knowing(partial(_Layout, calls, header))
                data = frame({"ok": True, **layout.header()})
            elif header.get("call") == "bye":
                return
            else:
                if header.get("call") == "replace":
                    layout = None
                data = _called(calls, header, payload, limits)
        except Disconnected:
            raise
        except UuvsimError as error:
            data = frame(failure(error))
        except Exception as error:  # a mistake of ours must not take the others down
            data = frame(failure(error))
        send(data)


def _values(calls: Calls, header: Mapping[str, Any], payload: bytes) -> dict[str, Any]:
    values = unpacked(header["columns"], payload, calls.schema) if "columns" in header else {}
    if "columns" not in header and payload:
        raise InputInvalid(f"payload of {len(payload)} bytes without columns that name it")
    if "values" in header:
        values.update(taken(header["values"], calls.schema))
    return values


def _called(calls: Calls, header: Mapping[str, Any], payload: bytes, limits: Limits) -> bytes:
    values = calls.knowing(lambda: _values(calls, header, payload))
    request = {k: v for k, v in header.items() if k not in ("columns", "values")}
    return _framed(calls.answer(request, values), calls, limits)


def _framed(answer: Answer, calls: Calls, limits: Limits) -> bytes:
    columns, texts, payload = columns_of(answer.values, calls.schema)
    if len(payload) > limits.answer_bytes:
        raise InputInvalid(
            f"the answer has {len(payload)} bytes; at most {limits.answer_bytes} are sent: "
            "record fewer signals, or run in pieces"
        )
    header = {"ok": True, **answer.header, "columns": columns, "texts": texts}
    return frame(header, payload)


def _compact(calls: Calls, layout: _Layout | None, payload: bytes) -> bytes:
    if layout is None:
        raise InputInvalid("a frame without header is a compact step; ask for a layout first")
    numbers = np.frombuffer(payload, dtype="<f8")
    if numbers.size != layout.ends[-1]:
        raise InputInvalid(
            f"step: {numbers.size - 1} input numbers were read; the layout has "
            f"{layout.ends[-1] - 1}: {', '.join(i.name for i in layout.inputs) or 'none'}"
        )
    n = whole(float(numbers[0]))
    inputs = {
        info.name: typed(info, numbers[begin:end])
        for info, begin, end in zip(layout.inputs, layout.ends, layout.ends[1:], strict=False)
    }
    moment, found = calls.waited("step", n, inputs, layout.names)
    parts = [np.array([moment.tick, moment.time])]
    parts += [np.asarray(found[name], dtype=np.float64).ravel() for name in layout.names]
    return frame(None, np.concatenate(parts).astype("<f8", copy=False).tobytes())


def _list(request: Mapping[str, Any], field: str) -> list[str]:
    read = request.get(field, [])
    read = [read] if isinstance(read, str) else read
    if not isinstance(read, list) or not all(isinstance(n, str) for n in read):
        raise InputInvalid(f"{field}: {read!r} was read; expected a list of names")
    return read
