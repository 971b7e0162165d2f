"""Work is done by the machines of a Ray cluster: each call anew where its worker dies, once for us.

>>> with Cluster("10.0.0.7:6379") as cluster:
...     for number, square in cluster.spread(pow_2, [3, 4, 5]):
...         print(number, square)  # doctest: +SKIP

What is asked must follow from its arguments alone; then it does not matter where it was done.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, TypeVar, final

from uuvsim_cosim.closing import Closing
from uuvsim_cosim.cluster.address import connect
from uuvsim_cosim.cluster.versions import difference, told_by_a_node, versions
from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["Cluster"]

P = TypeVar("P")
R = TypeVar("R")
RETRIES = 3  # of a call whose worker or machine dies
PATIENCE = 60.0  # s, without any machine that could work
PROBE = 120.0  # s, for a machine to say which versions it has


@final
class Cluster(Closing):
    """A connection to a Ray cluster; what it began ends with it.

    `address` is host:port of the head, ray://host:port (Ray Client), "auto" (the cluster that this
    machine belongs to, or RAY_ADDRESS), or "local" (started here, with `workers` processes, and
    ended afterwards). `alike` names packages that must have one version everywhere. Raises
    InputInvalid for an address where there is no cluster, and for machines with other versions.
    """

    def __init__(
        self, address: str, *, workers: int | None = None, alike: Iterable[str] = ()
    ) -> None:
        self.address = address
        self._alike = tuple(alike)
        self._here = versions(self._alike)
        self._ray, self._end = connect(address, workers)
        self._running: set[Any] = set()
        self._lock = threading.Lock()
        try:
            self._check_nodes()
            self._work = self._ray.remote(num_cpus=1)(_work)
        except BaseException:
            self.close()
            raise

    @property
    def cpus(self) -> int:
        """Return how many calls can be worked on at once, as the cluster is now."""
        return int(self._ray.cluster_resources().get("CPU", 0))

    def put(self, value: Any) -> Any:
        """Keep a value in the cluster, which calls are then given instead of `Kept.value`."""
        return self._ray.put(value)

    def call(self, work: Callable[..., R], *arguments: Any) -> R:
        """Return `work(*arguments)`, worked out somewhere; from any thread.

        Where the worker dies it is done again, RETRIES times. Raises InputInvalid or UuvsimError
        with the sentence of whatever went wrong there.
        """
        ref = self._begin(work, arguments)
        return self._result(ref)  # type: ignore[no-any-return]

    def spread(
        self,
        work: Callable[[P], R],
        pieces: Iterable[P],
        follow: Callable[[int, R], P | None] | None = None,
    ) -> Iterator[tuple[int, R]]:
        """Return (number of the piece, what work gives of it) as they come.

        `follow(number, result)` may give the piece that comes after a result, with its number.
        """
        waiting = deque(enumerate(pieces))
        running: dict[Any, int] = {}
        try:
            while waiting or running:
                while waiting and len(running) < 2 * max(self.cpus, 1):
                    number, piece = waiting.popleft()
                    running[self._begin(work, (piece,))] = number
                ref = self._first(list(running))
                number = running.pop(ref)
                result: R = self._result(ref)
                after = None if follow is None else follow(number, result)
                if after is not None:
                    waiting.appendleft((number, after))
                yield number, result
        finally:
            self._cancel(list(running))

    def close(self) -> None:
        """End what is still being done, and the connection; a second call does nothing."""
        if self._ray is None:
            return
        with self._lock:
            running = list(self._running)
        self._cancel(running)
        self._end()
        self._ray = None

    # ---- inside ---------------------------------------------------------------------------

    def _begin(self, work: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        asked = self._work.options(max_retries=RETRIES)
        ref = asked.remote(self._here, self._alike, work, arguments)
        with self._lock:
            self._running.add(ref)
        return ref

    def _first(self, refs: list[Any]) -> Any:
        """Wait for one; raises UuvsimError when there is nobody left who could do it."""
        alone = 0.0
        while True:
            done, _ = self._ray.wait(refs, timeout=5.0)
            if done:
                return done[0]
            alone = 0.0 if self.cpus else alone + 5.0
            if alone >= PATIENCE:
                raise UuvsimError(
                    f"{self.address}: no machine with a CPU has been in the cluster for "
                    f"{PATIENCE:g} s; what is finished is kept"
                )

    def _result(self, ref: Any) -> Any:
        from ray.exceptions import RayError

        try:
            good, answer = self._ray.get(self._first([ref]))
        except RayError as error:
            raise UuvsimError(
                f"{self.address}: what was asked of a worker ended without an answer, "
                f"{RETRIES + 1} times ({type(error).__name__}: {_short(error)}); what is finished "
                "is kept"
            ) from None
        finally:
            with self._lock:
                self._running.discard(ref)
        if not good:
            raise answer
        return answer

    def _cancel(self, refs: list[Any]) -> None:
        for ref in refs:
            if self._ray is not None and self._ray.is_initialized():
                self._ray.cancel(ref, force=True)
        with self._lock:
            self._running.difference_update(refs)

    def _check_nodes(self) -> None:
        """Refuse a cluster without a CPU, and machines with other versions than this one."""
        from ray.exceptions import GetTimeoutError, RayError
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy as On

        nodes = [n for n in self._ray.nodes() if n["Alive"] and n["Resources"].get("CPU")]
        if not nodes:
            raise InputInvalid(f"{self.address}: a cluster without a CPU; expected at least one")
        ask = self._ray.remote(num_cpus=0, max_retries=0)(told_by_a_node())
        asked = [
            ask.options(scheduling_strategy=On(n["NodeID"], soft=False)).remote(self._alike)
            for n in nodes
        ]
        for node, ref in zip(nodes, asked, strict=True):
            place = f"{self.address}, machine {node['NodeManagerHostname']}"
            try:
                there: Mapping[str, str] = self._ray.get(ref, timeout=PROBE)
            except GetTimeoutError:
                raise InputInvalid(f"{place}: has not answered for {PROBE:g} s") from None
            except RayError as error:
                raise InputInvalid(f"{place}: {_short(error)}") from None
            if wrong := difference(self._here, there):
                raise InputInvalid(f"{place}: {wrong}")


def _work(
    here: Mapping[str, str], alike: tuple[str, ...], work: Callable[..., Any],
    arguments: tuple[Any, ...],
) -> tuple[bool, Any]:  # fmt: skip
    """Do it, in a worker; gives (True, the result) or (False, an error to raise)."""
    import socket

    try:
        if wrong := difference(here, versions(alike)):
            raise InputInvalid(f"machine {socket.gethostname()}: {wrong}")
        return True, work(*arguments)
    except InputInvalid as error:
        return False, InputInvalid(str(error))
    except UuvsimError as error:
        return False, UuvsimError(str(error))
    except Exception as error:
        return False, UuvsimError(f"{type(error).__name__}: {error}")


def _short(error: BaseException) -> str:
    lines = [text.strip() for text in str(error).splitlines() if text.strip()]
    return lines[0][:160] if lines else type(error).__name__
