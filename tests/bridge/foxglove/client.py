"""A client of Foxglove's WebSocket protocol, and messages of its channels as dictionaries."""

from __future__ import annotations

import base64
import json
import struct
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

__all__ = ["FoxgloveClient", "connected", "decoder", "nothing"]

PATIENCE = 60.0  # [s] after which a message counts as missing


def nothing() -> None:
    """Do nothing while waiting."""


def decoder(name: str, schema: bytes) -> type[Any]:
    """Return the class of a Protobuf message, from the descriptors of a channel."""
    files = descriptor_pb2.FileDescriptorSet.FromString(schema)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    found: type[Any] = message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
    return found


class FoxgloveClient:
    """Reads what the server sends; `wait` returns the first message that is wanted."""

    def __init__(self, raw: ClientConnection) -> None:
        self.raw = raw
        self.channels: dict[str, dict[str, Any]] = {}
        self.services: dict[str, dict[str, Any]] = {}
        self.statuses: list[str] = []
        self._by_id: dict[int, dict[str, Any]] = {}
        self._unread = defaultdict[str, deque[dict[str, Any]]](deque)
        self._calls, self._published = 0, 0
        self.info = self.wait(lambda m: m.get("op") == "serverInfo")
        self.wait(lambda m: m.get("op") == "advertiseServices")

    def send(self, **message: Any) -> None:
        self.raw.send(json.dumps(message))

    def read(self, timeout: float = PATIENCE) -> dict[str, Any]:
        """Read one message; binary ones get op data, time or answer."""
        data = self.raw.recv(timeout)
        if isinstance(data, str):
            message: dict[str, Any] = json.loads(data)
            for channel in message.get("channels", ()):
                self.channels[channel["topic"]] = channel
            for service in message.get("services", ()):
                self.services[service["name"]] = service
            if message["op"] == "status":
                self.statuses.append(message["message"])
            return message
        if data[0] == 1:
            number, at = struct.unpack_from("<IQ", data, 1)
            channel = self._by_id[number]
            found = {
                "op": "data", "topic": channel["topic"], "at": at * 1e-9,
                "data": self._decoded(channel, data[13:]),
            }  # fmt: skip
            self._unread[channel["topic"]].append(found)
            return found
        if data[0] == 2:
            return {"op": "time", "at": struct.unpack_from("<Q", data, 1)[0] * 1e-9}
        _, call, length = struct.unpack_from("<III", data, 1)
        return {"op": "answer", "callId": call, "data": json.loads(data[13 + length :])}

    def wait(
        self, wanted: Callable[[dict[str, Any]], bool], meanwhile: Callable[[], object] = nothing
    ) -> dict[str, Any]:
        """Read until a message is wanted."""
        for _ in range(100_000):
            meanwhile()
            if wanted(message := self.read()):
                return message
        raise AssertionError("the message did not come")

    def advertised(self, count: int) -> dict[str, dict[str, Any]]:
        """Return the channels, once there are so many."""
        while len(self.channels) < count:
            self.read()
        return self.channels

    def subscribe(self, *topics: str) -> None:
        """Subscribe to topics, which are waited for."""
        for topic in topics:
            if topic not in self.channels:
                self.wait(lambda m: topic in self.channels)  # noqa: B023
        listed = []
        for topic in topics:
            number = len(self._by_id) + 1
            self._by_id[number] = self.channels[topic]
            listed.append({"id": number, "channelId": self.channels[topic]["id"]})
        self.send(op="subscribe", subscriptions=listed)

    def message(
        self, topic: str, wanted: Callable[[dict[str, Any]], bool] = lambda m: True
    ) -> dict[str, Any]:
        """Return the next message of a topic that is wanted; earlier ones are skipped."""
        while True:
            unread = self._unread[topic]
            while unread:
                if wanted(found := unread.popleft()):
                    return found
            self.read()

    def status(self) -> str:
        """Return the first status that was not returned yet."""
        if not self.statuses:
            self.wait(lambda m: m["op"] == "status")
        return self.statuses.pop(0)

    def parameters(self, *names: str) -> dict[str, Any]:
        """Get parameters."""
        self.send(op="getParameters", parameterNames=list(names), id="get")
        return _values(self.wait(lambda m: m.get("id") == "get"))

    def set(self, **values: Any) -> dict[str, Any]:
        """Set parameters, whose names have __ for a dot; return the answer's values."""
        listed = [{"name": k.replace("__", "."), "value": v} for k, v in values.items()]
        self.send(op="setParameters", parameters=listed, id="set")
        return _values(self.wait(lambda m: m.get("id") == "set"))

    def ask(self, service: str, request: Any = None, *, raw: bytes | None = None) -> int:
        """Call a service without waiting; return the number of the call."""
        payload = raw if raw is not None else json.dumps(request or {}).encode()
        self._calls += 1
        head = struct.pack("<BIII", 2, self.services[service]["id"], self._calls, 4)
        self.raw.send(head + b"json" + payload)
        return self._calls

    def call(self, service: str, request: Any = None, *, raw: bytes | None = None) -> Any:
        """Call a service; return its answer, or the message of its failure."""
        number = self.ask(service, request, raw=raw)
        answer = self.wait(lambda m: m.get("callId") == number)
        return answer["data"] if answer["op"] == "answer" else answer["message"]

    def publish(self, topic: str, *messages: bytes, encoding: str = "json") -> None:
        """Publish messages on a channel of this client."""
        self._published += 1
        channel = {"id": self._published, "topic": topic, "encoding": encoding, "schemaName": ""}
        self.send(op="advertise", channels=[channel])
        for message in messages:
            self.raw.send(struct.pack("<BI", 1, self._published) + message)

    def _decoded(self, channel: dict[str, Any], data: bytes) -> Any:
        if channel["encoding"] == "json":
            return json.loads(data)
        type_ = decoder(channel["schemaName"], base64.b64decode(channel["schema"]))
        return json_format.MessageToDict(
            type_.FromString(data), preserving_proto_field_name=True,
            always_print_fields_with_no_presence=True,
        )  # fmt: skip


def _values(message: dict[str, Any]) -> dict[str, Any]:
    return {p["name"]: p.get("value") for p in message["parameters"]}


@contextmanager
def connected(port: int, **options: Any) -> Iterator[FoxgloveClient]:
    """Connect as Foxglove does."""
    scheme = "wss" if "ssl" in options else "ws"
    settings = {"proxy": None, "max_size": None, "max_queue": None, **options}
    spoken = [Subprotocol("foxglove.sdk.v1")]
    with connect(f"{scheme}://127.0.0.1:{port}", subprotocols=spoken, **settings) as raw:
        yield FoxgloveClient(raw)
