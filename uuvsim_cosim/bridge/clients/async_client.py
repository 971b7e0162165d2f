"""The Python client for asyncio: the calls of `Connection` as coroutines."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial, wraps
from types import TracebackType
from typing import Any, Concatenate, ParamSpec, Self, TypeVar, final

from uuvsim_cosim.bridge.calls.service import Moment, SignalInfo
from uuvsim_cosim.bridge.clients.client import Connection, connect
from uuvsim_cosim.bridge.clients.subscription import Block

__all__ = ["AsyncConnection", "connect_async"]

P = ParamSpec("P")
T = TypeVar("T")


async def connect_async(system: str | None = None, **options: Any) -> AsyncConnection:
    """Connect to a co-simulation from asyncio; `system` and `options` are those of `connect`.

    The calls of the connection are coroutines, which a thread makes in order, one at a time. Raises
    the errors of `connect`.

    Example:

    >>> import asyncio
    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.bridge import connect_async
    >>> async def surge(port):
    ...     async with await connect_async(port=port) as client:
    ...         return await client.step(10, {"hull.tau": [50, 0, 0, 0, 0, 0]}, ["hull.nu[1]"])
    >>> boat = uuv.System("boat", tick="0.1").add("hull", "model:bluerov2_heavy")
    >>> with uuv.Bridge(boat, port=0) as bridge:
    ...     asyncio.run(surge(bridge.port))  # m/s after 1 s with 50 N
    {'hull.nu[1]': 0.548...}
    """
    calls = ThreadPoolExecutor(1, "uuvsim-client")
    made = partial(connect, system, **options)
    try:
        connection = await asyncio.get_running_loop().run_in_executor(calls, made)
    except BaseException:
        calls.shutdown(wait=False)
        raise
    return AsyncConnection(connection, calls)


def _coroutine(
    call: Callable[Concatenate[Connection, P], T],
) -> Callable[Concatenate[AsyncConnection, P], Coroutine[Any, Any, T]]:
    """Return a call of `Connection` as a coroutine of `AsyncConnection`."""

    @wraps(call)
    async def made(self: AsyncConnection, /, *args: P.args, **options: P.kwargs) -> T:
        return await self._made(lambda: call(self.connection, *args, **options))

    return made


@final
class AsyncConnection:
    """A `Connection` whose calls are coroutines; a thread makes them in order, one at a time."""

    def __init__(self, connection: Connection, calls: ThreadPoolExecutor) -> None:
        self.connection = connection
        self._calls = calls

    @property
    def moment(self) -> Moment:
        """The communication point at the last answer."""
        return self.connection.moment

    @property
    def system(self) -> str:
        """The name of the system."""
        return self.connection.system

    @property
    def name(self) -> str:
        """The name that others see of this client."""
        return self.connection.name

    @property
    def time(self) -> float:
        """Time at the last answer [s]."""
        return self.connection.time

    @property
    def tick(self) -> int:
        """Communication point at the last answer."""
        return self.connection.tick

    async def schema(self) -> tuple[SignalInfo, ...]:
        """List all variables."""
        return await self._made(lambda: self.connection.schema)

    async def signals(self) -> tuple[str, ...]:
        """List the names of all variables."""
        return await self._made(lambda: self.connection.signals)

    async def get(self, names: str | Sequence[str]) -> Any:
        """Read a variable, or several by name."""
        return await self._made(partial(self.connection.get, names))

    async def set(self, name: str | Mapping[str, object], value: object = None, /) -> Moment:
        """Set unconnected inputs and tunable parameters, all or none."""
        values = {name: value} if isinstance(name, str) else name
        return await self._made(partial(self.connection.set, values))

    async def pause(self) -> Moment:
        """Stop streaming at a communication point; also stops a run that another task awaits."""
        return await asyncio.to_thread(self.connection.pause)

    describe = _coroutine(Connection.describe)
    step = _coroutine(Connection.step)
    run = _coroutine(Connection.run)
    reset = _coroutine(Connection.reset)
    snapshot = _coroutine(Connection.snapshot)
    restore = _coroutine(Connection.restore)
    discard = _coroutine(Connection.discard)
    dismiss = _coroutine(Connection.dismiss)
    replace = _coroutine(Connection.replace)

    async def subscribe(self, *names: str, keep: int = 1024) -> AsyncIterator[Block]:
        """Yield the blocks of states as they arrive."""
        blocks = await self._made(partial(self.connection.subscribe, *names, keep=keep))
        try:
            while (block := await asyncio.to_thread(next, blocks, None)) is not None:
                yield block
        finally:
            blocks.close()

    async def close(self) -> None:
        """Leave; a second call does nothing."""
        await asyncio.to_thread(self.connection.close)
        self._calls.shutdown(wait=False)

    async def __aenter__(self) -> Self:
        """Return the connection."""
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave."""
        await self.close()

    async def _made(self, call: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._calls, call)
