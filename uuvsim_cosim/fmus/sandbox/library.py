"""An FMU's module in wasmtime with the functions of its C interface, which C can call.

`fmus/sandbox/*.c` has these functions: they copy arguments into the module's memory and call it.
Each instance of the FMU has a memory of its own.
"""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, final

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.codegen.toolchain import Signatures, compile_shared
from uuvsim_cosim.fmus.importer.fmu_library import FmuLibrary
from uuvsim_cosim.fmus.importer.message_log import logger_library
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.isolation.guard import Guarded
from uuvsim_cosim.fmus.sandbox.engine import compiled_module, engine, interrupted, ticks_of
from uuvsim_cosim.fmus.sandbox.host import Exit, Host, define_imports

__all__ = ["SandboxLibrary", "host_library"]

# The functions of wasmtime in the order of the structure `wasmtime` of uuv_sandbox.h.
_FUNCTIONS = (
    "wasmtime_func_call_unchecked", "wasmtime_context_set_epoch_deadline", "wasmtime_memory_data",
    "wasmtime_memory_data_size", "wasmtime_memory_grow", "wasmtime_error_message",
    "wasmtime_error_delete", "wasmtime_trap_code", "wasm_trap_message", "wasm_trap_delete",
    "wasm_byte_vec_delete",
)  # fmt: skip
_TABLES, _ELEMENTS, _MEMORIES = 16, 1 << 16, 4  # that a module may have
_LOG = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int32, ctypes.c_char_p, ctypes.c_char_p)
_numbers = itertools.count()


@lru_cache
def host_library() -> ctypes.CDLL:
    """Load the C side, compiled at first use."""
    folder = content("fmus", "sandbox")
    files = sorted(folder.glob("sandbox*.c"))
    c = ctypes.CDLL(str(compile_shared(files, name="uuv_sandbox", include=[folder])))
    p, i, s = ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p
    for name, result, arguments in (
        ("size", ctypes.c_size_t, []),
        ("names", ctypes.POINTER(s), []),
        ("open", None, [p, p, p, p, ctypes.c_uint64]),
        ("function", None, [p, i, p]),
        ("reason", s, [p]),
        ("end", None, [p, s]),
        ("instantiate_fmi2", p, [p, i, s, s, s, i, ctypes.c_uint32, p, p]),
        ("instantiate_fmi3", p, [p, i, s, s, s, i, ctypes.c_uint32, p, p]),
    ):
        function = getattr(c, f"uuv_sandbox_{name}")
        function.restype, function.argtypes = result, arguments
    return c


@lru_cache
def _names() -> dict[str, int]:
    """Return the place of each function of FMI in the C side's table."""
    names = host_library().uuv_sandbox_names()
    return {
        names[k].decode(): k for k in itertools.takewhile(lambda k: names[k], itertools.count())
    }


@final
class SandboxLibrary(FmuLibrary):
    """A module in a memory of its own; `host` has what it reaches outside of it.

    A call that takes longer than `watchdog` seconds is interrupted, after which the FMU has failed.
    """

    def __init__(
        self, module: Path, watchdog: float | None, host: Host,
        archive: FmuArchive, prefix: str, signatures: Signatures,
    ) -> None:  # fmt: skip
        from wasmtime import Linker, Store, WasmtimeError
        from wasmtime import Memory as WasmMemory
        from wasmtime import _ffi as ffi

        self.archive = archive
        self.file = module.with_name(f"{module.name}#{next(_numbers)}")  # no file: one instance
        self._prefix = prefix
        self._signatures = signatures
        self._bound = {}
        self._shim = host_library()
        place = str(archive.path)
        made = compiled_module(module, place)
        self._host = host
        self._store = Store(engine())
        self._store.set_limits(host.limit, _ELEMENTS, 1, _TABLES, _MEMORIES)
        linker = Linker(engine())
        define_imports(linker, self._host, made.imports, place)
        self._ticks = ticks = ticks_of(watchdog)
        if watchdog is not None:
            interrupted(self)
        self._store.set_epoch_deadline(ticks)
        try:
            instance = linker.instantiate(self._store, made)
            self._exports = instance.exports(self._store)
            self._run("_initialize")
        except (WasmtimeError, Exit) as error:
            reason = str(error).splitlines()[0]
            raise FmuError(
                place, f"its WebAssembly cannot start: {reason}", "a module that can"
            ) from None
        found = self._exports.get("memory")
        if not isinstance(found, WasmMemory):
            raise FmuError(place, "its WebAssembly exports no memory", "one named memory")
        self._state = ctypes.create_string_buffer(self._shim.uuv_sandbox_size())
        self._at = ctypes.addressof(self._state)
        api = (ctypes.c_void_p * len(_FUNCTIONS))(
            *(ctypes.cast(getattr(ffi.dll, f), ctypes.c_void_p) for f in _FUNCTIONS)
        )
        context = ctypes.cast(self._store._context(), ctypes.c_void_p)
        self._shim.uuv_sandbox_open(self._at, api, context, ctypes.byref(found._memory), ticks)
        shim, at = self._shim, self._at
        host.end = lambda reason: shim.uuv_sandbox_end(at, reason.encode())
        self._functions = self._linked()

    def _linked(self) -> set[str]:
        """Tell the C side the functions that the module exports; return their full names."""
        from wasmtime import Func

        found = set()
        for name, k in _names().items():
            for full in (name, f"{self.archive.model_identifier}_{name}"):
                function = self._exports.get(full)
                if isinstance(function, Func):
                    self._shim.uuv_sandbox_function(self._at, k, ctypes.byref(function._func))
                    found.add(name)
                    break
        return found

    def function(self, name: str) -> Callable[..., Any]:
        """Bind a function at its first use; raises FmuError if the module does not export it."""
        if not name.startswith("Instantiate"):
            return super().function(name)
        self._raw(name)
        if name not in self._bound:
            full = f"{self._prefix}{name}".encode()
            function = partial(self._instantiate, name)
            self._bound[name] = Guarded(function, self.component, full)
        return self._bound[name]

    def _instantiate(self, name: str, *given: Any) -> int | None:
        """Instantiate with the module's own callbacks, which pass messages on."""
        c = logger_library()
        report = ctypes.cast(c.uuv_log_fmi3, ctypes.c_void_p).value
        made: int | None
        resources: bytes | None
        if self._prefix == "fmi2":
            path, kind, token, _, callbacks, _, logging_on = given
            environment = (ctypes.c_void_p * 5).from_address(callbacks)[4]
            first, resources = kind, b"file:///resources"
        else:
            exchange = name == "InstantiateModelExchange"
            path, token, folder, _, logging_on = given[:5]
            environment = given[5] if exchange else given[9]
            first, resources = int(exchange), b"/resources/" if folder else None
        log = _LOG(report or 0)
        self._host.report = lambda status, category, text: log(
            environment, status, category.encode(), text.encode()
        )
        instantiate = getattr(self._shim, f"uuv_sandbox_instantiate_{self._prefix}")
        made = instantiate(
            self._at, first, path, token, resources, int(logging_on),
            self._run(f"uuv_guest_{self._prefix}"), environment, report,
        )  # fmt: skip
        return made

    def _raw(self, name: str) -> Any:
        """Find the C side's function; raises FmuError if the module does not export it."""
        full = f"{self._prefix}{name}"
        if full not in self._functions:
            raise FmuError(f"{self.archive.path}: does not export {full}, which is needed")
        if name.startswith("Instantiate"):
            return None
        found = self._shim[f"sandbox_{full}"]
        found.restype, found.argtypes = self._signatures[name]
        return found

    def addresses(self) -> dict[str, int]:
        """Return the addresses of the C side's functions for those that the module exports."""
        names = [n for n in self._signatures if f"{self._prefix}{n}" in self._functions]
        return {
            name: ctypes.cast(self._raw(name), ctypes.c_void_p).value or 0
            for name in names
            if not name.startswith("Instantiate")
        }

    def _run(self, name: str) -> int:
        """Call a function of the module without arguments; 0 if there is none."""
        function: Any = self._exports.get(name)
        self._store.set_epoch_deadline(self._ticks)
        return 0 if function is None else (function(self._store) or 0)
