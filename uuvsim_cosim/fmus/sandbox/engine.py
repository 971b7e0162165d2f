"""The engine of wasmtime, its compiled modules, and the clock that interrupts calls.

wasmtime is the extra `sandbox`. Its settings keep the bits of the native code: no relaxed SIMD, no
threads. NaNs keep the bits of the processor's instructions, as in native code.
"""

from __future__ import annotations

import ctypes
import math
import threading
import time
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar
from weakref import WeakSet

from uuvsim_cosim.cache import cache_dir, content_hash, intact, keep
from uuvsim_cosim.errors import FmuError, ToolchainError
from uuvsim_cosim.fmus.isolation.guard import guard_library

if TYPE_CHECKING:
    from wasmtime import Engine, Module

__all__ = ["FOREVER", "compiled_module", "engine", "interrupted", "require_wasmtime", "ticks_of"]

_T = TypeVar("_T")
FOREVER = 1 << 62  # [ticks]
_TICK = 0.1  # [s]
_watched: WeakSet[object] = WeakSet()
_lock = threading.Lock()
_clock: list[threading.Thread] = []


def require_wasmtime() -> None:
    """Raise ToolchainError if wasmtime is missing."""
    if find_spec("wasmtime") is None:
        raise ToolchainError(
            "--isolate wasm", "the package 'wasmtime' is missing",
            "it with `pip install 'uuvsim-cosim[sandbox]'`",
        )  # fmt: skip


@lru_cache
def engine() -> Engine:
    """Return the engine of this process; raises ToolchainError without wasmtime."""
    require_wasmtime()
    from wasmtime import Config, Engine

    # The handlers of signals that wasmtime installs with its engine must come after those of the
    # guard: they are then called first, keep the traps, and pass only real crashes on.
    guard_library()
    config = Config()
    config.epoch_interruption = True
    config.wasm_relaxed_simd = False
    config.wasm_threads = False
    config.cranelift_nan_canonicalization = False
    return _kept(Engine(config))


def _kept(thing: _T) -> _T:
    """Return an object that lives as long as the process: wasmtime cannot free it at the end."""
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(thing))
    return thing


@lru_cache
def compiled_module(file: Path, place: str) -> Module:
    """Return a module, compiled for this machine once and then kept in the cache.

    Raises FmuError for a file that is no module; `place` names its FMU.
    """
    from importlib.metadata import version

    from wasmtime import Module, WasmtimeError

    data = file.read_bytes()
    key = content_hash(["module", version("wasmtime"), data])
    kept = cache_dir("compiled", key) / f"{file.stem}.cwasm"
    if intact(kept):
        try:
            return _kept(Module.deserialize(engine(), kept.read_bytes()))
        except WasmtimeError:  # of another processor, with which this cache is shared
            pass
    try:
        made = Module(engine(), data)
    except WasmtimeError as error:
        reason = str(error).splitlines()[0]
        raise FmuError(place, f"its WebAssembly is not valid ({reason})", "a module") from None
    keep(kept, bytes(made.serialize()))
    return _kept(made)


def ticks_of(seconds: float | None) -> int:
    """Return the number of the clock's ticks after which a call has taken so many seconds."""
    return FOREVER if seconds is None else math.ceil(seconds / _TICK) + 1


def interrupted(owner: object) -> None:
    """Let the clock run while `owner` lives, so that its calls are interrupted in time."""
    with _lock:
        _watched.add(owner)
        if not _clock:
            _clock.append(threading.Thread(target=_run, args=[engine()], daemon=True))
            _clock[0].start()


def _run(watched: Engine) -> None:
    while True:
        time.sleep(_TICK)
        watched.increment_epoch()
        with _lock:
            if not _watched:
                _clock.clear()
                return
