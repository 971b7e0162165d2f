"""A running system for Foxglove: channels, parameters and services over its WebSocket protocol."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple, final

import numpy as np

from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.foxglove.channels import Message, Output, nanoseconds, outputs_of
from uuvsim_cosim.bridge.foxglove.georeference import around, georeference_of
from uuvsim_cosim.bridge.foxglove.permissions import Permissions
from uuvsim_cosim.bridge.foxglove.requests import Requests
from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.bridge.ros2.rows import Block, Layout, Rows
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.closing import Owner, started
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.orchestrator.master.observer import Chunk, Column
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["FOXGLOVE_PORT", "Drawing", "FoxgloveServer", "foxglove_sdk"]

FOXGLOVE_PORT = 8765  # to which Foxglove connects by default
Drawing = Callable[[Plan], Sequence[Output]]
"""A function that returns the channels with which a system is drawn."""

_CHUNKS = 128  # chunks of rows that wait at most; older ones are dropped
_BYTES = 1 << 20  # of a chunk at most, except for one row
_ROWS = 64  # of a chunk at most: a run that is as fast as possible sends its newest rows
_MOST = 40  # rows of a turn that are published; of more, an even selection
_PAUSE = 0.02  # [s] between two turns
_LOOK = 0.5  # [s] between two checks of the parameters that are watched
_BACKLOG = 512  # messages that wait for one client at most; older ones are dropped


def foxglove_sdk() -> Any:
    """Return the module of foxglove-sdk; raises InputInvalid if it is not installed."""
    try:
        import foxglove
    except ImportError:
        raise InputInvalid(
            "Foxglove", "foxglove-sdk is not installed", "`pip install 'uuvsim-cosim[foxglove]'`"
        ) from None
    log = logging.getLogger("foxglove")
    if log.level == logging.NOTSET:  # a client gets its errors as a status; a flood stays silent
        log.setLevel(logging.CRITICAL + 1)
    return foxglove


class _Run(NamedTuple):
    """Layout of the rows of a run, and its channels by topic."""

    layout: Layout
    channels: dict[str, tuple[Output, Any]]


@final
class FoxgloveServer(Owner):
    """Server of a co-simulation for Foxglove, from construction to `close`.

    Each channel is encoded while it has a subscriber. Messages are made and sent by a thread of the
    server: a client that is slow loses messages and never delays the system. `drawing` adds the
    channels of the scene. Raises InputInvalid without the extra ``foxglove``, and for a port that
    cannot be opened.
    """

    def __init__(
        self,
        conductor: Conductor,
        port: int = FOXGLOVE_PORT,
        permissions: Permissions | None = None,
        *,
        drawing: Drawing | None = None,
        origin: tuple[float, float] | None = None,
    ) -> None:
        self._sdk = foxglove_sdk()
        given = Permissions() if permissions is None else permissions
        self._conductor, self._drawing = conductor, drawing
        self._place = None if origin is None else around(*origin)
        self._client = Client("foxglove", "foxglove", given.allowed)
        self._context = self._sdk.Context()
        self._run: _Run | None = None
        self._ring: deque[tuple[_Run, Array, Array, Mapping[str, Array]]] = deque(maxlen=_CHUNKS)
        self._newest: tuple[_Run, Block] | None = None  # and its last row
        self._wake, self._over = threading.Event(), False
        self._requests = Requests(conductor, self._client, given.reason, self._wake.set)
        self.dropped = 0  # rows
        self._servers: list[Any] = []
        with self._opening() as opened:
            conductor.watch(self)
            opened.callback(self._leave)
            self._newest = self._now()
            opened.callback(self._stop)
            for host in given.hosts:
                first = self._servers[0].port if self._servers else port
                self._servers.append(self._opened(host, first, given))
            self.addresses = tuple(
                f"{'ws' if given.certificate is None else 'wss'}://"
                f"{f'[{host}]' if ':' in host else host}:{self.port}"
                for host in given.hosts
            )
            self._thread = started("uuvsim-foxglove", self._publish)
            opened.callback(self._end)

    @property
    def port(self) -> int:
        """The port of all its addresses."""
        return int(self._servers[0].port)

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics of its channels."""
        return () if self._run is None else tuple(self._run.channels)

    def _opened(self, host: str, port: int, given: Permissions) -> Any:
        from foxglove.websocket import Capability

        capabilities = [Capability.Time, Capability.Parameters, Capability.Services]
        if "set" in given.allowed:
            capabilities.append(Capability.ClientPublish)
        try:
            return self._sdk.start_server(
                name=str(self._conductor.describe()["system"]), host=host, port=port,
                capabilities=capabilities, server_listener=self._requests,
                supported_encodings=["json"], services=self._requests.services(),
                context=self._context, message_backlog_size=_BACKLOG,
                tls_cert=given.certificate, tls_key=given.key,
            )  # fmt: skip
        except RuntimeError as error:
            reason = str(error).removeprefix("FoxgloveError: ")
            raise InputInvalid(
                f"Foxglove at {host}:{port}", reason, "a free port, such as 0 for any"
            ) from None

    # ---- the observer, in the conductor's thread ------------------------------------------

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        """Open the channels of a new run; those that do not change stay open."""
        layout = Layout(columns, plan.tick)
        outputs = outputs_of(plan, layout, self._place or georeference_of(plan))
        if self._drawing is not None:
            outputs += self._drawing(plan)
        left = {} if self._run is None else dict(self._run.channels)
        channels: dict[str, tuple[Output, Any]] = {}
        for output in outputs:
            before = left.get(output.topic)
            if before is not None and before[0].form == output.form:
                channels[output.topic] = (output, left.pop(output.topic)[1])
        for _, channel in left.values():
            channel.close()
        for output in outputs:
            if output.topic not in channels:
                channels[output.topic] = (output, self._channel(output))
        self._run = _Run(layout, channels)

    def observe(self, chunk: Chunk) -> None:
        """Copy the newest rows; never wait."""
        run = self._run
        if run is None:
            return
        most = max(1, min(_ROWS, _BYTES // (8 * max(1, len(run.layout.columns)))))
        rows = chunk.rows[-most:]
        self.dropped += len(chunk.rows) - len(rows)
        texts = {
            name: np.stack([chunk.values(int(i))[-most:] for i in at.flat], axis=1)
            for name, at in run.layout.texts.items()
        }
        self._ring.append((run, chunk.ticks[-most:].copy(), rows.copy(), texts))
        self._wake.set()

    def end(self) -> None:
        """Do nothing: `close` ends the server."""

    def _channel(self, output: Output) -> Any:
        form = output.form
        schema = self._sdk.Schema(name=form.name, encoding=form.schema_encoding, data=form.schema)
        return self._sdk.Channel(
            output.topic, schema=schema, message_encoding=form.encoding, context=self._context
        )

    # ---- the thread that publishes ----------------------------------------------------------

    def _publish(self) -> None:
        looked = time.monotonic()
        while not self._over:
            self._wake.wait(_LOOK)
            self._wake.clear()
            with contextlib.suppress(InputInvalid):  # the co-simulation has ended
                self._turn()
                if time.monotonic() - looked >= _LOOK:
                    looked = time.monotonic()
                    changed = self._requests.changed()
                    for server in self._servers if changed else ():
                        server.publish_parameter_values(changed)
            self._requests.closed.wait(_PAUSE)

    def _turn(self) -> None:
        taken = [self._ring.popleft() for _ in range(len(self._ring))]
        for run, group in groupby(taken, key=lambda chunk: chunk[0]):
            _, *parts, texts = zip(*group, strict=True)
            ticks, rows = map(np.concatenate, parts)
            every = {name: np.concatenate([t[name] for t in texts]) for name in run.layout.texts}
            back = np.flatnonzero(np.diff(ticks) < 0) + 1  # a reset, or an earlier snapshot
            for part in np.split(np.arange(len(ticks)), back):
                picks = part[np.unique(np.linspace(0, len(part) - 1, _MOST).astype(int))]
                chosen = {name: t[picks] for name, t in every.items()}
                self._send(run, run.layout.rows(ticks[picks], rows[picks], chosen))
        fresh = {self._requests.fresh.pop() for _ in range(len(self._requests.fresh))}
        if self._newest is not None:
            self._send_whole(*self._newest, fresh)
        if taken and self._newest is not None:
            [now] = nanoseconds(self._newest[1].time)
            for server in self._servers:
                server.broadcast_time(now)
        for text in self._requests.turn():
            self._status(text)

    def _send(self, run: _Run, rows: Rows) -> None:
        before, self._newest = self._newest, (run, rows.last)
        for output, channel in list(run.channels.values()):
            if channel.has_sinks():
                self._log(run, output, channel, output.messages(rows))
        if before is not None and rows.time[0] < before[1].time[0]:
            # Foxglove forgets all it has drawn when time goes back.
            self._send_whole(run, rows.last, list(run.channels))

    def _send_whole(self, run: _Run, newest: Block, topics: Iterable[str]) -> None:
        for topic in topics:
            found = run.channels.get(topic)
            if found is not None and found[1].has_sinks():
                self._log(run, *found, found[0].whole(newest))

    def _log(self, run: _Run, output: Output, channel: Any, messages: Iterable[Message]) -> None:
        try:
            for at, data in messages:
                channel.log(data, log_time=at)
        except Exception as error:  # one channel that fails must not stop the others
            run.channels.pop(output.topic, None)
            channel.close()
            self._status(f"{output.topic}: {error}; the channel is closed")

    def _status(self, text: str) -> None:
        for server in self._servers:
            server.publish_status(text, self._sdk.StatusLevel.Error)

    # ---- beginning and end -----------------------------------------------------------------

    def _now(self) -> tuple[_Run, Block] | None:
        """Return the values of the current communication point as one row."""
        run = self._run
        if run is None:
            return None
        moment = self._conductor.moment()
        values = self._conductor.get(Client("foxglove", "local"), run.layout.names)
        return run, run.layout.row(moment.time, values)

    def _leave(self) -> None:
        with contextlib.suppress(UuvsimError):  # the co-simulation has ended already
            self._conductor.unwatch(self)

    def _end(self) -> None:
        self._over = True
        self._requests.closed.set()
        self._wake.set()
        self._thread.join()

    def _stop(self) -> None:
        self._requests.closed.set()
        for server in self._servers:
            server.stop()
