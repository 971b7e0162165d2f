"""The calls that a client can make to a running co-simulation, over any transport.

Every transport (Zenoh, TCP, HTTP) turns a request into one of these calls, and the result into its
own format. Names are those of a local master, "hull.eta"; values are numpy arrays of the
variable's shape and type, in its unit.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, final, overload

import numpy as np

from uuvsim_cosim.cache import content_hash

__all__ = ["Client", "Moment", "Schema", "Service", "SignalInfo", "entry", "interface_hash"]


def entry(info: SignalInfo) -> Mapping[str, object]:
    """Return the entry of a signal in a layout."""
    return {"name": info.name, "type": info.type, "shape": list(info.shape)}


def interface_hash(inputs: Iterable[SignalInfo], outputs: Iterable[SignalInfo]) -> str:
    """Hash names, types, shapes and units, in this order."""
    parts = []
    for what, infos in (("inputs", inputs), ("outputs", outputs)):
        parts.append(what)
        parts += [repr((i.name, i.type, tuple(i.shape), i.unit)) for i in infos]
    return content_hash(parts)


@dataclass(frozen=True)
class SignalInfo:
    """One variable: `settable` if it is an unconnected input or a tunable parameter."""

    name: str
    type: str  # FMI 3's: Float64, Int32, Boolean, String, …
    shape: tuple[int, ...]
    unit: str  # one, or one for each element joined by ", "
    causality: str
    settable: bool
    description: str = ""


@final
class Schema(Sequence[SignalInfo]):
    """All variables. A schema never changes, so that derived data is computed once."""

    def __init__(self, signals: Iterable[SignalInfo]) -> None:
        self._signals = tuple(signals)

    @overload
    def __getitem__(self, index: int) -> SignalInfo: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[SignalInfo]: ...
    def __getitem__(self, index: int | slice) -> SignalInfo | Sequence[SignalInfo]:
        """Return one variable, or several."""
        return self._signals[index]

    def __len__(self) -> int:
        """Return the number of variables."""
        return len(self._signals)

    @cached_property
    def by_name(self) -> Mapping[str, SignalInfo]:
        """Return the variables by name."""
        return {info.name: info for info in self._signals}

    @cached_property
    def text(self) -> str:
        """Return the variables as a JSON list."""
        return json.dumps([asdict(info) for info in self._signals])


@dataclass(frozen=True)
class Client:
    """A client: a name that it chooses (made unique), its transport, and its permissions.

    `answer_bytes` is the largest recording of a run that its connection can carry; None for a
    client in this process.
    """

    name: str
    transport: str  # "zenoh", "tcp", "http", "local"
    allowed: frozenset[str] = frozenset({"read", "set", "step", "manage"})
    answer_bytes: int | None = None


@dataclass(frozen=True)
class Moment:
    """Communication point and run state; every answer and every published block carries them."""

    tick: int
    time: float  # s
    running: bool  # streaming against the wall clock


class Service(ABC):
    """The calls. Each may come from any thread; they are carried out one after another.

    A call that cannot be carried out, or that the client's role does not allow, raises UuvsimError.
    Its message names the place, the value that was read, and what was expected (similar names for
    an unknown one).
    """

    @abstractmethod
    def ask(self, call: str, client: Client, *arguments: object) -> Future[Any]:
        """Put a call in the queue, without waiting for its answer."""

    @abstractmethod
    def abandon(self, answer: Future[Any]) -> None:
        """End the run of an answer that its client does not wait for any more."""

    @abstractmethod
    def moment(self) -> Moment:
        """Return the current communication point."""

    @abstractmethod
    def schema(self) -> Schema:
        """List all variables; the same object until a component is replaced."""

    @property
    def folders(self) -> Sequence[Path]:
        """The folders of the recordings so far; empty if this process records nothing."""
        return ()

    def describe(self) -> Mapping[str, Any]:
        """Return the system: name, version, tick, components with kind and step, clients, mode."""
        return dict(self.ask("describe", Client("anybody", "local", frozenset())).result())

    def get(self, client: Client, names: Sequence[str]) -> Mapping[str, Any]:
        """Read variables at the current communication point."""
        return dict(self.ask("get", client, names).result())

    def set(self, client: Client, values: Mapping[str, object]) -> Moment:
        """Set unconnected inputs and tunable parameters, all or none."""
        return self._moment_after("set", client, values)

    def step(
        self,
        client: Client,
        n: int = 1,
        inputs: Mapping[str, object] | None = None,
        outputs: Sequence[str] = (),
    ) -> tuple[Moment, Mapping[str, Any]]:
        """Set inputs, make n communication steps, and return outputs.

        In lockstep with other clients, the call waits until all clients that hold the barrier have
        requested a step. The smallest number of steps is made for all; a client that requested
        more keeps waiting.
        """
        moment, values = self.ask("step", client, n, inputs, outputs).result()
        return moment, values

    def run(
        self,
        client: Client,
        until: float | None = None,
        factor: float | None = None,
        record: Sequence[str] = (),
    ) -> Mapping[str, np.ndarray]:
        """Run to a time [s] as fast as possible (factor None) or at a factor of real time.

        Returns the time and the recorded signals, one row for each communication point. Without
        `until` it streams until `pause`, and returns nothing.
        """
        return dict(self.ask("run", client, until, factor, record).result())

    def pause(self, client: Client) -> Moment:
        """Stop streaming at a communication point."""
        return self._moment_after("pause", client)

    def reset(
        self, client: Client, seed: int | None = None, start: Mapping[str, object] | None = None
    ) -> Moment:
        """Go back to the start, with another seed or other start values."""
        return self._moment_after("reset", client, seed, start)

    def snapshot(self, client: Client) -> str:
        """Store the whole state until it is discarded; return the name of the snapshot."""
        return str(self.ask("snapshot", client).result())

    def restore(self, client: Client, snapshot: str) -> Moment:
        """Go back to a snapshot."""
        return self._moment_after("restore", client, snapshot)

    def discard(self, client: Client, snapshot: str) -> Moment:
        """Delete a snapshot."""
        return self._moment_after("discard", client, snapshot)

    def replace(
        self, client: Client, component: str, source: str, mapping: Mapping[str, str] | None = None
    ) -> Moment:
        """Replace the source of a component; the run begins again from the start."""
        return self._moment_after("replace", client, component, source, mapping)

    def join(self, client: Client, *, lockstep: bool = False, lag: float = 5.0) -> Client:
        """Add a client; with `lockstep` it holds the barrier, and is dropped after `lag` s."""
        joined: Client = self.ask("join", client, lockstep, lag).result()
        return joined

    def leave(self, client: Client) -> None:
        """Remove a client; the barrier no longer waits for it."""
        self.ask("leave", client).result()

    def lost(self, client: Client) -> None:
        """Remove a client that has disconnected; if it held the barrier, the fail-safe decides."""
        self.ask("lost", client).result()

    def dismiss(self, client: Client, name: str) -> Moment:
        """Remove another client from the barrier; its next step raises an error."""
        return self._moment_after("dismiss", client, name)

    def _moment_after(self, call: str, client: Client, *arguments: object) -> Moment:
        moment: Moment = self.ask(call, client, *arguments).result()
        return moment
