"""The functions that a module may import: messages, refused memory, and WASI.

WASI is the interface of C libraries to files, clocks and processes. The clock can be read, and
printed lines become messages. Everything else is refused and reported once.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from uuvsim_cosim.fmus.isolation.grants import size_text
from uuvsim_cosim.fmus.sandbox.sources import NoWebAssembly

if TYPE_CHECKING:
    from wasmtime import Caller, ImportType, Linker, Memory

__all__ = ["Exit", "Host", "define_imports"]

WASI = "wasi_snapshot_preview1"
_BAD_DESCRIPTOR, _NOT_ALLOWED, _NO_SYSTEM = 8, 2, 52
# The imports of modules of this package, by module and name: the functions of `Host`.
_OWN = {
    "uuv": {"log": "log", "more": "more"},
    "fmi:fmi3/callbacks@3.0.0": {"log-message": "log_message"},
    **{
        f"[export]fmi:fmi3/{kind}@3.0.0": {f"[resource-new]{kind}-instance": "resource"}
        for kind in ("co-simulation", "model-exchange")
    },
}
_OK = 0
_HEADER = 16  # [bytes] that the C library adds to a piece of memory; it takes a power of two
_MOST = 20  # refusals that are reported
_FOLDER = 3  # the descriptor of "/", which exists so that C libraries ask for the files in it


class Exit(Exception):
    """The module called exit()."""


class Host:
    """What a module reaches outside of it, whose memory is limited to `limit` bytes.

    `report` passes a message on, with status, category and text. Refusals are kept in `notes` until
    `note` is set.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.report: Callable[[int, str, str], None] = lambda status, category, text: None
        self.notes: list[str] = []
        self.note: Callable[[str], None] = self.notes.append
        self.end: Callable[[str], None] = lambda reason: None  # of the module, which cannot go on
        self._seen: set[str] = set()
        self._line = b""

    # ---- the module's own imports -------------------------------------------------------------

    def log(self, caller: Caller, status: int, category: int, text: int) -> None:
        """Pass a message of the FMU on."""
        self.report(status, _text(caller, category), _text(caller, text))

    def log_message(
        self, caller: Caller, name: int, n_name: int, status: int, category: int, n_category: int,
        text: int, n_text: int,
    ) -> None:  # fmt: skip
        """Pass a message of a component on."""
        self.report(status, _text(caller, category), _text(caller, text))

    def resource(self, caller: Caller, instance: int) -> int:
        """Return the handle of an instance, which nobody uses here."""
        return instance

    def more(self, caller: Caller, size: int) -> None:
        """Report memory that is refused."""
        size &= 0xFFFFFFFF
        rounded = 1 << (size + _HEADER - 1).bit_length()
        asked, up, has, limit = (
            size_text(n) for n in (size, rounded, _memory(caller).data_len(caller), self.limit)
        )
        self.refused(
            "memory",
            f"it asked for {asked} of memory, which its C library rounds up to {up}, has {has}, "
            f"and may have {limit} in all",
        )

    def refused(self, key: str, what: str) -> None:
        """Report the first refusal of a kind."""
        if key not in self._seen and len(self._seen) < _MOST:
            self._seen.add(key)
            self.note(f"{what}, which WebAssembly refuses")

    # ---- WASI ---------------------------------------------------------------------------------

    def args_sizes_get(self, caller: Caller, count: int, size: int) -> int:
        """Report that there are no arguments."""
        _put(caller, count, 0)
        _put(caller, size, 0)
        return 0

    environ_sizes_get = args_sizes_get

    def environ_get(self, caller: Caller, *places: int) -> int:
        """Give no variables of the environment."""
        return 0

    args_get = environ_get

    def clock_time_get(self, caller: Caller, clock: int, precision: int, place: int) -> int:
        """Give the time of the clock in ns."""
        _put(caller, place, time.time_ns() if clock == 0 else time.monotonic_ns(), 8)
        return 0

    def fd_prestat_get(self, caller: Caller, descriptor: int, place: int) -> int:
        """Describe the folder "/"."""
        if descriptor != _FOLDER:
            return _BAD_DESCRIPTOR
        _put(caller, place, 0)
        _put(caller, place + 4, 1)
        return 0

    def fd_prestat_dir_name(self, caller: Caller, descriptor: int, place: int, size: int) -> int:
        """Name that folder."""
        _memory(caller).write(caller, b"/", place)
        return 0

    def fd_fdstat_get(self, caller: Caller, descriptor: int, place: int) -> int:
        """Describe standard output as a character device, and the folder as a folder."""
        if descriptor > _FOLDER:
            return _BAD_DESCRIPTOR
        kind = 3 if descriptor == _FOLDER else 2
        _memory(caller).write(caller, bytes([kind]) + bytes(7) + b"\xff" * 16, place)
        return 0

    def fd_write(self, caller: Caller, descriptor: int, vectors: int, count: int, done: int) -> int:
        """Make messages of the lines that are printed."""
        if descriptor not in (1, 2):
            return _BAD_DESCRIPTOR
        memory, size = _memory(caller), 0
        for k in range(min(count, 1024)):
            place = vectors + 8 * k
            words = memory.read(caller, place, place + 8)
            start, length = (int.from_bytes(words[i : i + 4], "little") for i in (0, 4))
            self._line += bytes(memory.read(caller, start, start + length))
            size += length
        *lines, self._line = self._line.split(b"\n")
        if len(self._line) > 1 << 16:
            lines, self._line = [*lines, self._line], b""
        for line in lines:
            self.report(_OK, "", line.decode(errors="replace"))
        _put(caller, done, size)
        return 0

    def path_open(
        self, caller: Caller, descriptor: int, flags: int, path: int, size: int, *more: Any
    ) -> int:
        """Refuse a file."""
        name = bytes(_memory(caller).read(caller, path, path + size)).decode(errors="replace")
        self.refused(f"file {name}", f"it tried to open the file /{name.lstrip('/')}")
        return _NOT_ALLOWED

    def proc_exit(self, caller: Caller, status: int) -> None:
        """End the module."""
        self.end(f"it called exit({status})")
        raise Exit


def define_imports(linker: Linker, host: Host, imports: list[ImportType], place: str) -> None:
    """Define the functions that a module imports; raises NoWebAssembly for unknown ones."""
    from wasmtime import FuncType

    unknown = []
    for wanted in imports:
        module, name, kind = wanted.module, wanted.name or "", wanted.type
        own = _OWN.get(module, {}).get(name)
        if not isinstance(kind, FuncType) or (module != WASI and own is None):
            unknown.append(f"{module}.{name}")
            continue
        function = _function(host, name if own is None else own)
        linker.define_func(module, name, kind, function, access_caller=True)
    if unknown:
        raise NoWebAssembly(
            place,
            f"its WebAssembly imports {', '.join(unknown)}, which the sandbox does not have",
            "a module that imports no more than WASI",
        )


def _function(host: Host, name: str) -> Callable[..., Any]:
    found: Callable[..., Any] | None = getattr(host, name, None)
    if found is not None and not name.startswith("_"):
        return found

    def refuse(*arguments: Any) -> int:
        host.refused(name, f"it tried to call {name}()")
        return _NO_SYSTEM

    return refuse


def _memory(caller: Caller) -> Memory:
    memory: Any = caller["memory"]
    return memory


def _text(caller: Caller, place: int) -> str:
    memory, place = _memory(caller), place & 0xFFFFFFFF
    data, size = bytearray(), memory.data_len(caller)
    while place < size and b"\0" not in data and len(data) < 1 << 16:
        data += memory.read(caller, place, min(place + 256, size))
        place += 256
    return bytes(data.partition(b"\0")[0]).decode(errors="replace")


def _put(caller: Caller, place: int, value: int, size: int = 4) -> None:
    _memory(caller).write(caller, value.to_bytes(size, "little"), place)
