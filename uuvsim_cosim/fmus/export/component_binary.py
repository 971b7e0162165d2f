"""Encoding of a module with FMI's functions as a WebAssembly component of FMI-LS-WASM.

The component imports the types and the callback for messages; it exports one interface for each
kind of instance. wasmtime's assembler encodes its text, in which the module is empty; the module
then takes its place, and nothing else of the bytes depends on it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from uuvsim_cosim.fmus.export.component_interface import (
    PACKAGE,
    SHARED_TYPES,
    VERSION,
    Interface,
    Method,
)

__all__ = ["component_of", "modules_of"]

_TYPES, _CALLBACKS, _COMMON = (
    f"{PACKAGE}/{name}@{VERSION}" for name in ("types", "callbacks", "common")
)
_EMPTY = b"\0asm\x01\0\0\0"
_COMPONENT = b"\0asm\x0d\0\x01\0"
_MODULE = 1  # kind of a section


def component_of(module: bytes, interfaces: Sequence[Interface]) -> bytes:
    """Return the component of a module; raises ImportError without wasmtime."""
    from wasmtime import wat2wasm

    encoded = bytes(wat2wasm(_text(interfaces)))
    out, placed = bytearray(_COMPONENT), False
    for kind, content in _sections(encoded):
        body = content
        if kind == _MODULE and not placed:  # the first one, which is empty but for its name
            body, placed = module, True
        out += bytes([kind]) + _number(len(body)) + body
    return bytes(out)


def modules_of(component: bytes) -> list[bytes] | None:
    """Return the modules directly inside a component; None if these are no bytes of a component."""
    if component[:8] != _COMPONENT:
        return None
    try:
        return [content for kind, content in _sections(component) if kind == _MODULE]
    except IndexError:  # the file is cut off
        return None


# ---- text -------------------------------------------------------------------------------------


def _text(interfaces: Sequence[Interface]) -> str:
    lines = ["(component $all", f'(import "{_TYPES}" (instance $types']
    for name, of in SHARED_TYPES.items():
        lines.append(f'(type ${name}-is {of}) (export "{name}" (type ${name} (eq ${name}-is)))')
    lines.append("))")
    lines += [f'(alias export $types "{name}" (type ${name}))' for name in SHARED_TYPES]
    lines.append(
        f'(import "{_CALLBACKS}" (instance $callbacks (alias outer $all $status (type $s)) '
        '(export "status" (type $status (eq $s))) (export "log-message" (func '
        '(param "instance-name" string) (param "status" $status) (param "category" string) '
        '(param "message" string)))))'
    )
    lines += ["(core module $main)", *_linking(interfaces)]
    lines.append(_lifted(f"{_COMMON}#get-version", "$get-version", "", "(result string)"))
    for k, interface in enumerate(interfaces):
        for name, of in interface.types.items():
            lines.append(f"(type ${name} {of})")
        for i, (method, form) in enumerate(_functions(interface)):
            core = f"{interface.full_name}#{method}"
            signature = form.replace("$instance", f"$instance{k}")
            lines.append(_lifted(core, f"$f{k}-{i}", signature, ""))
    lines.append(
        '(component $common (import "f" (func $f (result string))) '
        '(export "get-version" (func $f)))'
        '(instance $common (instantiate $common (with "f" (func $get-version))))'
        f'(export "{_COMMON}" (instance $common))'
    )
    for k, interface in enumerate(interfaces):
        lines += _exported(k, interface)
    return "\n".join([*lines, ")"])


def _linking(interfaces: Sequence[Interface]) -> Iterator[str]:
    """Yield the instantiation of the module.

    Its destructors and the lowered callback need the instance, which needs them: they are called
    through a table, which is filled at the end.
    """
    n = len(interfaces)
    words = "(param i32 i32 i32 i32 i32 i32 i32)"
    passed = " ".join(f"local.get {i}" for i in range(7))
    yield (
        f"(core module $shim (type $d (func (param i32))) (type $l (func {words})) "
        f'(table (export "t") {n + 1} {n + 1} funcref)'
    )
    for k in range(n):
        yield f'(func (export "d{k}") (type $d) local.get 0 i32.const {k} call_indirect (type $d))'
    yield f'(func (export "l") (type $l) {passed} i32.const {n} call_indirect (type $l)))'
    names = [f"d{k}" for k in range(n)]
    yield "(core module $fill (type $d (func (param i32)))"
    yield f'(import "" "t" (table {n + 1} {n + 1} funcref))'
    yield "".join(f'(import "" "{name}" (func ${name} (type $d)))' for name in names)
    yield f'(import "" "l" (func $l {words})) (import "" "i" (func $i))'
    yield f"(elem (i32.const 0) func {' '.join('$' + name for name in names)} $l) (start $i))"
    yield "(core instance $shim (instantiate $shim))"
    yield '(alias core export $shim "l" (core func $log))'
    yield '(alias core export $shim "t" (core table $t))'
    for k in range(n):
        yield f'(alias core export $shim "d{k}" (core func $drop{k}))'
        yield f"(type $instance{k} (resource (rep i32) (dtor (core func $drop{k}))))"
        yield f"(core func $new{k} (canon resource.new $instance{k}))"
    yield "(core instance $main (instantiate $main"
    for k, interface in enumerate(interfaces):
        yield (
            f'(with "[export]{interface.full_name}" (instance '
            f'(export "[resource-new]{interface.resource}" (func $new{k}))))'
        )
    yield f'(with "{_CALLBACKS}" (instance (export "log-message" (func $log))))))'
    yield '(alias core export $main "memory" (core memory $memory))'
    yield '(alias core export $main "cabi_realloc" (core func $realloc))'
    yield '(alias core export $main "_initialize" (core func $initialize))'
    yield '(alias export $callbacks "log-message" (func $log-message))'
    yield "(core func $lowered (canon lower (func $log-message) (memory $memory)"
    yield "string-encoding=utf8))"
    for k, interface in enumerate(interfaces):
        name = f"{interface.full_name}#[dtor]{interface.resource}"
        yield f'(alias core export $main "{name}" (core func $destroy{k}))'
    filled = "".join(f'(export "d{k}" (func $destroy{k}))' for k in range(n))
    yield (
        f'(core instance (instantiate $fill (with "" (instance (export "t" (table $t)) {filled} '
        '(export "l" (func $lowered)) (export "i" (func $initialize))))))'
    )


def _functions(interface: Interface) -> Iterator[tuple[str, str]]:
    """Yield the name and the signature of each function, with ``$instance``."""
    resource = interface.resource
    yield f"[static]{resource}.{interface.make.name}", _signature(interface.make)
    for method in interface.methods:
        yield f"[method]{resource}.{method.name}", _signature(method, own=True)


def _signature(method: Method, *, own: bool = False) -> str:
    given = (("self", "(borrow $instance)"), *method.parameters) if own else method.parameters
    parameters = "".join(f'(param "{name}" {of})' for name, of in given)
    return f"{parameters}(result {method.result})"


def _lifted(core: str, name: str, signature: str, result: str) -> str:
    return (
        f'(alias core export $main "{core}" (core func {name}-core))'
        f"(func {name} {signature}{result} (canon lift (core func {name}-core) (memory $memory) "
        "(realloc $realloc) string-encoding=utf8))"
    )


def _exported(k: int, interface: Interface) -> Iterator[str]:
    """Yield an interface's export: a component inside gives names to its types."""
    types = {**SHARED_TYPES, **interface.types}
    yield f"(component $exports{k}"
    for name, of in types.items():
        yield f'(type ${name}-is {of}) (import "type-{name}" (type ${name} (eq ${name}-is)))'
    yield f'(import "type-{interface.resource}" (type $instance (sub resource)))'
    functions = [*_functions(interface)]
    for i, (_, signature) in enumerate(functions):
        yield f'(import "f{i}" (func $f{i} {signature}))'
    for name in types:
        yield f'(export $x-{name} "{name}" (type ${name}))'
    yield f'(export $x-instance "{interface.resource}" (type $instance))'
    for i, (name, signature) in enumerate(functions):
        renamed = signature.replace("$", "$x-")
        yield f'(export "{name}" (func $f{i}) (func {renamed}))'
    yield f") (instance $interface{k} (instantiate $exports{k}"
    for name in types:
        yield f'(with "type-{name}" (type ${name}))'
    yield f'(with "type-{interface.resource}" (type $instance{k}))'
    for i in range(len(functions)):
        yield f'(with "f{i}" (func $f{k}-{i}))'
    yield f')) (export "{interface.full_name}" (instance $interface{k}))'


# ---- bytes ------------------------------------------------------------------------------------


def _sections(component: bytes) -> Iterator[tuple[int, bytes]]:
    at = 8
    while at < len(component):
        kind, at = component[at], at + 1
        size, shift = 0, 0
        while True:
            byte = component[at]
            at += 1
            size |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                break
        yield kind, component[at : at + size]
        at += size


def _number(n: int) -> bytes:
    """Encode an unsigned number as LEB128."""
    out = bytearray()
    while n >= 0x80:
        out.append(n & 0x7F | 0x80)
        n >>= 7
    return bytes([*out, n])
