"""The Python client of a running co-simulation in another process or on another machine."""

from __future__ import annotations

import json
import secrets
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, final, overload

import numpy as np

from uuvsim_cosim._version import __version__
from uuvsim_cosim.bridge.calls.call_table import checked
from uuvsim_cosim.bridge.calls.service import Moment, SignalInfo
from uuvsim_cosim.bridge.calls.zenoh_keys import call_key, client_key, master_key
from uuvsim_cosim.bridge.clients.access import Credentials, Reply
from uuvsim_cosim.bridge.clients.queries import QuerySender
from uuvsim_cosim.bridge.clients.subscription import Subscription
from uuvsim_cosim.bridge.zenoh.codec import PROTOCOL, error_of, packed, read_message, unpacked
from uuvsim_cosim.bridge.zenoh.session import PORT, Disconnected, WrappedSession
from uuvsim_cosim.closing import Closing
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["Connection", "connect"]


def connect(
    system: str | None = None,
    *,
    host: str = "127.0.0.1",
    port: int = PORT,
    name: str = "python",
    lockstep: bool = False,
    lag: float = 5.0,
    user: str | None = None,
    password: str | None = None,
    ca: str | Path | None = None,
    certificate: str | Path | None = None,
    key: str | Path | None = None,
    token: str | None = None,
) -> Connection:
    """Connect to a co-simulation that `uuvsim serve` or a `Bridge` runs at `host` and `port`.

    The connection reads and sets variables (`get`, `set`, `signals`, `schema`, `describe`),
    advances time (`step`, `run`, `pause`), goes back (`reset`, `snapshot`, `restore`, `discard`),
    replaces components (`replace`) and receives states as they come (`subscribe`). `time` is the
    time [s] at the last answer. docs/connections/connect_python.md shows each of them.

    `system` is needed only if the server has several. Other clients see this client as `name`. With
    `lockstep`, time advances only when this client and all others in lockstep have requested their
    step; after `lag` seconds without a request, the fail-safe of the co-simulation decides how the
    others continue. `user` and `password`, and the PEM files `ca` (with it, TLS is used),
    `certificate` and `key` are needed if the server asks for them. `token` is that of a server
    without an access file; for a server of this user on this machine, it is found automatically.

    Raises Disconnected if there is no server, and InputInvalid with the reason if the client is
    refused. A refused call raises the error that a local master raises.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> boat = uuv.System("boat", tick="0.1").add("hull", "model:bluerov2_heavy")
    >>> bridge = uuv.Bridge(boat, port=0)  # or `uuvsim serve` in another terminal
    >>> client = uuv.connect(port=bridge.port)
    >>> client.step(10, {"hull.tau": [50, 0, 0, 0, 0, 0]}, ["hull.nu[1]"])  # N; m/s
    {'hull.nu[1]': 0.548...}
    >>> client.time  # s: ten communication steps of 0.1 s
    1.0
    >>> client.close()
    >>> bridge.close()
    """
    if isinstance(port, bool) or not isinstance(port, int) or not 0 < port < 1 << 16:
        raise InputInvalid("connect", f"port {port!r}", "a whole number, 1 to 65535")
    checked("join", {"name": name, "lockstep": lockstep, "lag": lag})
    credentials = Credentials(user, password, ca, certificate, key, token)
    session = credentials.opened(host, port)
    try:
        served = sorted(key.split("/")[1] for key in session.alive(master_key()))
        if system is not None and system not in served:
            raise InputInvalid(
                f"no co-simulation {system!r} at {host}, port {port}",
                expected_names(system, served),
            )
        if len(served) != 1 and system is None:
            raise InputInvalid(
                f"{len(served)} co-simulations at {host}, port {port}", expected_names("", served)
            )
        chosen = system or served[0]
        return Connection(session, chosen, name, lockstep, lag, credentials, (host, port))
    except BaseException:
        session.close()
        raise


@final
class Connection(Closing):
    """A client of a running co-simulation; it leaves when it is closed, or the program ends."""

    def __init__(
        self,
        session: WrappedSession,
        system: str,
        name: str,
        lockstep: bool,
        lag: float,
        credentials: Credentials,
        address: tuple[str, int],
    ) -> None:
        self.system = system
        self._session = session
        self._credentials = credentials
        self._address = address
        self._states: WrappedSession | None = None
        self._proof: dict[str, str] = {}
        self._asking = QuerySender(session, lambda: self._credentials.opened(*address))
        self._schema: tuple[SignalInfo, ...] | None = None
        self._subscriptions: list[Subscription] = []
        self._id = secrets.token_hex(8)
        self._token = session.token(client_key(system, self._id))
        joining = {
            "name": name, "lockstep": lockstep, "lag": lag, "protocol": PROTOCOL,
            "version": __version__,
        }  # fmt: skip
        joined, _ = self._credentials.join(self._ask_at, system, joining, address)
        if joined.get("protocol") != PROTOCOL:
            raise InputInvalid(
                (
                    f"the co-simulation (uuvsim-cosim {joined.get('version', 'unknown')}) "
                    f"uses protocol {joined.get('protocol')}"
                ),
                f"protocol {PROTOCOL}, that of this client (uuvsim-cosim {__version__})",
            )
        self.name = str(joined["name"])
        self.allowed = frozenset(joined.get("allowed", ("read", "set", "step", "manage")))
        self._proof = {"proof": joined["proof"]} if "proof" in joined else {}
        self._reader: list[str] | None = joined.get("reader")
        self._watching = session.watch(master_key(system), self._master_changed)

    # ---- state and schema -----------------------------------------------------------------

    @property
    def time(self) -> float:
        """Time at the last answer [s]."""
        return self.moment.time

    @property
    def tick(self) -> int:
        """Communication point at the last answer."""
        return self.moment.tick

    def describe(self) -> dict[str, Any]:
        """Return system, version, tick, components, clients and mode."""
        return dict(self._ask("describe")[0]["result"])

    @property
    def schema(self) -> tuple[SignalInfo, ...]:
        """List all variables; queried once, and again after a replacement."""
        if self._schema is None:
            signals = self._ask("schema")[0]["signals"]
            self._schema = tuple(SignalInfo(**{**s, "shape": tuple(s["shape"])}) for s in signals)
        return self._schema

    @property
    def signals(self) -> tuple[str, ...]:
        """List the names of all variables."""
        return tuple(s.name for s in self.schema)

    # ---- values ---------------------------------------------------------------------------

    @overload
    def get(self, names: str) -> Any: ...
    @overload
    def get(self, names: Sequence[str]) -> dict[str, Any]: ...
    def get(self, names: str | Sequence[str]) -> Any:
        """Read a variable, or several by name."""
        wanted = _names("get", names)
        _, values = self._ask("get", names=wanted)
        return values[names] if isinstance(names, str) else values

    @overload
    def set(self, name: str, value: object, /) -> Moment: ...
    @overload
    def set(self, name: Mapping[str, object], /) -> Moment: ...
    def set(self, name: str | Mapping[str, object], value: object = None, /) -> Moment:
        """Set unconnected inputs and tunable parameters, all or none."""
        values = {name: value} if isinstance(name, str) else name
        self._ask("set", {"values": _values("set", values)})
        return self.moment

    # ---- time -----------------------------------------------------------------------------

    def step(
        self,
        n: int = 1,
        inputs: Mapping[str, object] | None = None,
        outputs: str | Sequence[str] = (),
    ) -> dict[str, Any]:
        """Set inputs, make n communication steps, and return outputs; `time` is the new time."""
        given, wanted = _values("step", inputs or {}), _names("step", outputs)
        return self._ask("step", {"inputs": given}, n=n, outputs=wanted)[1]

    def run(
        self,
        until: float | None = None,
        factor: float | None = None,
        record: str | Sequence[str] = (),
    ) -> dict[str, np.ndarray]:
        """Run to a time [s], as fast as possible or at a factor of real time; return the recording.

        Without `until` it streams in real time until `pause`, and returns nothing.
        """
        return self._ask("run", until=until, factor=factor, record=_names("run", record))[1]

    def pause(self) -> Moment:
        """Stop streaming at a communication point."""
        self._ask("pause")
        return self.moment

    def reset(self, seed: int | None = None, start: Mapping[str, object] | None = None) -> Moment:
        """Go back to the start, with another seed or other start values."""
        self._ask("reset", {"start": _values("reset", start or {})}, seed=seed)
        return self.moment

    def snapshot(self) -> str:
        """Store the whole state until it is discarded; return the name of the snapshot.

        Raises InputInvalid if this client has reached its number of snapshots.
        """
        return str(self._ask("snapshot")[0]["result"])

    def restore(self, snapshot: str) -> Moment:
        """Go back to a snapshot."""
        self._ask("restore", snapshot=snapshot)
        return self.moment

    def discard(self, snapshot: str) -> Moment:
        """Delete a snapshot."""
        self._ask("discard", snapshot=snapshot)
        return self.moment

    def replace(
        self, component: str, source: str, mapping: Mapping[str, str] | None = None
    ) -> Moment:
        """Replace the source of a component; the run begins again from the start."""
        given = None if mapping is None else dict(mapping)
        self._ask("replace", component=component, source=source, mapping=given)
        self._schema = None
        return self.moment

    def dismiss(self, name: str) -> Moment:
        """Remove another client, by its name in `describe`, from the lockstep barrier."""
        self._ask("dismiss", name=name)
        return self.moment

    def subscribe(self, *names: str, keep: int = 1024) -> Subscription:
        """Return an iterator of the blocks of states; the newest `keep` wait to be read."""
        paths = {c["path"] for c in self.describe()["components"]}
        if "read" not in self.allowed:
            may = ", ".join(sorted(self.allowed)) or "nothing"
            raise InputInvalid(f"subscribe: this client may {may}, but this call needs 'read'")
        session = self._session
        if self._reader is not None:  # Zenoh's access control lets only this user subscribe
            if self._states is None:
                user, password = self._reader
                self._states = self._credentials.opened(*self._address, user, password)
            session = self._states
        subscription = Subscription(
            session, self.system, names, paths, lambda: self._ask("schema")[0], keep
        )
        self._subscriptions.append(subscription)
        return subscription

    # ---- the end --------------------------------------------------------------------------

    def close(self) -> None:
        """Leave; a second call does nothing."""
        if not self._session.is_open:
            return
        try:
            self._ask("leave")
        except Disconnected:
            pass
        finally:
            self._asking.close()
            if self._states is not None:
                self._states.close()
            self._session.close()

    # ---- inside ---------------------------------------------------------------------------

    def _ask(
        self, call: str, values: Mapping[str, Mapping[str, object]] | None = None, /, **rest: object
    ) -> Reply:
        return self._ask_at(call_key(self.system, call), values, **self._proof, **rest)

    def _ask_at(
        self, key: str, values: Mapping[str, Mapping[str, object]] | None = None, /, **rest: object
    ) -> Reply:
        """Send a query; return the fields of its answer, and its values by name."""
        call = key.rpartition("/")[2]
        message: dict[str, object] = {"client": self._id, "binary": True, **rest}
        block = b""
        for field, given in (values or {}).items():  # one at most
            message[field], block = packed(given)
        if not self._session.is_open:
            raise Disconnected(f"{call}: this connection is closed; expected an open one")
        try:
            text = json.dumps(message, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise InputInvalid(
                call, f"cannot be sent ({error})", "numbers, texts and lists of them"
            ) from None
        reply = self._asking.ask(key, text, block)
        if reply is None:
            raise Disconnected(
                f"{call}: the co-simulation {self.system!r} has ended; expected it to run"
            )
        if reply.ok is None:
            raise error_of(read_message(b"" if reply.err is None else reply.err.payload.to_bytes()))
        answer = read_message(reply.ok.payload.to_bytes())
        attached = reply.ok.attachment
        if "moment" in answer:
            self.moment = Moment(**answer["moment"])  # the communication point at the last answer
        values_of_it = answer.get("values", {})
        return answer, unpacked(values_of_it, b"" if attached is None else attached.to_bytes())

    def _master_changed(self, key: str, lives: bool) -> None:
        """End the subscriptions if the co-simulation has ended."""
        if not lives:
            for subscription in self._subscriptions:
                subscription.close()


def _names(call: str, names: object) -> list[str]:
    given = [names] if isinstance(names, str) else names
    if not isinstance(given, Iterable) or isinstance(given, Mapping):
        raise InputInvalid(call, f"{names!r} was read", "names, such as 'hull.eta'")
    return list(given)


def _values(call: str, values: object) -> Mapping[str, object]:
    if not isinstance(values, Mapping):
        raise InputInvalid(
            call, f"{values!r} was read", "values by name, such as {'hull.tau': [0.0]}"
        )
    return values
