"""Distribution of calls to the machines of a Ray cluster; a call whose worker dies is repeated."""

from __future__ import annotations

import hashlib
import platform
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, final

from uuvsim_cosim._version import __version__
from uuvsim_cosim.closing import Closing
from uuvsim_cosim.cluster.address import connect
from uuvsim_cosim.errors import InputInvalid, UuvsimError

if TYPE_CHECKING:
    from ray import ObjectRef

__all__ = ["Cluster", "difference", "versions", "versions_of_a_node"]

ALWAYS = ("ray", "numpy", "casadi")
CONTENT = ("models", "fmus", "orchestrator")
ENDINGS = (".py", ".c", ".h", ".yaml", ".ssd", ".ssv", ".ssm")  # files that results depend on


def versions(alike: Iterable[str] = ()) -> dict[str, str]:
    """Return versions by name: Python, uuvsim-cosim (with a hash of its files), packages."""
    found = {"Python": platform.python_version(), "uuvsim-cosim": f"{__version__} ({_hash()})"}
    for name in (*ALWAYS, *alike):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "none"
    return found


def difference(here: Mapping[str, str], there: Mapping[str, str]) -> str:
    """Return the first difference of two machines as a clause; empty if they are the same."""
    wrong = [
        f"{name} {there.get(name, 'none')}; expected {here[name]}, as here"
        for name in here
        if there.get(name) != here[name]
    ]
    return wrong[0] if wrong else ""


def versions_of_a_node() -> Callable[[tuple[str, ...]], Mapping[str, str]]:
    """Return a function that reports a machine's versions.

    It is sent to the machine as code, so that it also runs on one without this package.
    """

    def report(alike: tuple[str, ...]) -> Mapping[str, str]:
        import platform as of

        try:
            from uuvsim_cosim.cluster.ray_cluster import versions as there
        except ImportError:
            return {"Python": of.python_version()}
        return there(alike)

    return report


@lru_cache(maxsize=1)
def _hash() -> str:
    """Return a hash of the package's files and content, which does not depend on their folder."""
    from uuvsim_cosim.content import content

    digest = hashlib.blake2b(digest_size=4)
    for root in (Path(__file__).parents[1], *(content(name) for name in CONTENT)):
        for file in sorted(f for ending in ENDINGS for f in root.rglob(f"*{ending}")):
            place = file.relative_to(root)
            if place.parts[0] not in ("_content", "dist"):
                digest.update(place.as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


P = TypeVar("P")
R = TypeVar("R")
RETRIES = 3  # of a call whose worker or machine dies
PATIENCE = 60.0  # [s] without a machine that could work
PROBE = 120.0  # [s] for a machine to report its versions


@final
class Cluster(Closing):
    """Connection to a Ray cluster, which distributes calls to its machines; a `with` closes it.

    `address` is host:port of the head, ray://host:port (Ray Client), "auto" (the cluster that this
    machine belongs to, or RAY_ADDRESS), or "local" (started here, with `workers` processes, and
    ended afterwards). `alike` names packages that must have the same version on all machines.

    The result of a call must depend on its arguments only, so that every machine gives the same
    result: if the worker of a call dies, the call is repeated, up to three times. Raises
    InputInvalid for an address without a cluster, for machines with other versions, and without the
    extra `distributed`.

    Example:

    >>> from math import factorial
    >>> from uuvsim_cosim.cluster import Cluster
    >>> cluster = Cluster("local", workers=1)  # of several machines: Cluster("10.0.0.7:6379")
    >>> cluster.cpus, cluster.call(factorial, 5)
    (1, 120)
    >>> sorted(cluster.spread(factorial, [3, 4]))  # (number of the piece, result)
    [(0, 6), (1, 24)]
    >>> def largest(kept):  # a worker reads a stored value with `ray.get`
    ...     import ray
    ...     return max(ray.get(kept))
    >>> cluster.call(largest, cluster.put([3, 1, 2]))
    3
    >>> cluster.close()
    """

    def __init__(
        self, address: str, *, workers: int | None = None, alike: Iterable[str] = ()
    ) -> None:
        self.address = address
        self._alike = tuple(alike)
        self._here = versions(self._alike)
        self._ray: Any  # the module, which has no types; None once closed
        self._ray, self._end = connect(address, workers)
        self._running: set[ObjectRef] = set()
        self._lock = threading.Lock()
        try:
            self._check_nodes()
            self._work = self._ray.remote(num_cpus=1)(_work)
        except BaseException:
            self.close()
            raise

    @property
    def cpus(self) -> int:
        """The number of CPUs in the cluster: of calls that it can work on at the same time."""
        return int(self._ray.cluster_resources().get("CPU", 0))

    def put(self, value: object) -> ObjectRef:
        """Store a `value` in the cluster, and return a reference to it.

        Pass the reference as an argument of calls that need the same large value. The function
        reads the value with `ray.get`.
        """
        return self._ray.put(value)

    def call(self, work: Callable[..., R], *arguments: object) -> R:
        """Return `work(*arguments)`, computed on any machine; may be called from any thread.

        Raises InputInvalid or UuvsimError with the message of an error of `work`, and UuvsimError
        if the workers of the call and of its three repetitions die, or if no machine with a CPU is
        in the cluster for 60 s.
        """
        result: R = self._result(self._begin(work, arguments))
        return result

    def spread(
        self,
        work: Callable[[P], R],
        pieces: Iterable[P],
        follow: Callable[[int, R], P | None] | None = None,
    ) -> Iterator[tuple[int, R]]:
        """Yield (number of the piece, `work(piece)`) in the order in which the calls end.

        `pieces` are counted from 0. `follow(number, result)` may return a next piece, which gets
        the same number and is worked on first. Raises the errors of `call`.
        """
        waiting = deque(enumerate(pieces))
        running: dict[ObjectRef, int] = {}
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
        """End the calls that still run, and the connection; a second call does nothing."""
        if self._ray is None:
            return
        with self._lock:
            running = list(self._running)
        self._cancel(running)
        self._end()
        self._ray = None

    # ---- inside ---------------------------------------------------------------------------

    def _begin(self, work: Callable[..., object], arguments: tuple[object, ...]) -> ObjectRef:
        options = self._work.options(max_retries=RETRIES)
        ref = options.remote(self._here, self._alike, work, arguments)
        with self._lock:
            self._running.add(ref)
        return ref

    def _first(self, refs: list[ObjectRef]) -> ObjectRef:
        """Wait for the first that ends; raises UuvsimError if no machine is left to work."""
        without_cpu = 0.0  # s
        while True:
            done, _ = self._ray.wait(refs, timeout=5.0)
            if done:
                return done[0]
            without_cpu = 0.0 if self.cpus else without_cpu + 5.0
            if without_cpu >= PATIENCE:
                raise UuvsimError(
                    f"{self.address}: no machine with a CPU has been in the cluster for "
                    f"{PATIENCE:g} s; finished results are kept"
                )

    def _result(self, ref: ObjectRef) -> Any:
        """Wait for a call; return its result, or raise its error."""
        from ray.exceptions import RayError

        try:
            good, answer = self._ray.get(self._first([ref]))
        except RayError as error:
            raise UuvsimError(
                f"{self.address}: a request to a worker ended without an answer, "
                f"{RETRIES + 1} times ({type(error).__name__}: {_short(error)}); what is finished "
                "is kept"
            ) from None
        finally:
            with self._lock:
                self._running.discard(ref)
        if not good:
            raise answer
        return answer

    def _cancel(self, refs: list[ObjectRef]) -> None:
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
            raise InputInvalid(self.address, "a cluster without a CPU", "at least one")
        query = self._ray.remote(num_cpus=0, max_retries=0)(versions_of_a_node())
        refs = [
            query.options(scheduling_strategy=On(n["NodeID"], soft=False)).remote(self._alike)
            for n in nodes
        ]
        for node, ref in zip(nodes, refs, strict=True):
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
    here: Mapping[str, str], alike: tuple[str, ...], work: Callable[..., object],
    arguments: tuple[object, ...],
) -> tuple[bool, object]:  # fmt: skip
    """Make a call, in a worker; return (True, the result) or (False, an error to raise)."""
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
