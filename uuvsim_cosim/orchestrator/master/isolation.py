"""Isolation of components by their paths: in a separate process, or as WebAssembly."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names

if TYPE_CHECKING:
    from uuvsim_cosim.fmus.instantiation.instantiate import Isolation

__all__ = ["WASM", "isolations"]

WASM = "wasm"


def isolations(isolate: Collection[str], paths: Sequence[str]) -> Mapping[str, Isolation]:
    """Return the isolation of each isolated component.

    `isolate` has paths, ``path=wasm``, ``*`` and ``wasm`` or ``*=wasm`` for all components. A
    component's own entry has priority. Raises InputInvalid for unknown names.

    Example:

    >>> isolations(["wasm", "b"], ["a", "b"])
    {'a': 'preferred', 'b': 'process'}
    """
    found: dict[str, Isolation] = {}
    own: dict[str, Isolation] = {}
    for text in isolate:
        if text == WASM and WASM in paths:
            raise InputInvalid(
                f"isolate {text}", "a component has this name",
                "wasm=wasm for this component, or *=wasm for all",
            )  # fmt: skip
        name, _, way = ("*", "", WASM) if text == WASM else text.partition("=")
        if way not in ("", WASM):
            raise InputInvalid(f"isolate {text}", f"the way {way!r}", f"component={WASM}")
        if name == "*":
            found = dict.fromkeys(paths, "preferred" if way else "process")
        elif name in paths:
            own[name] = "wasm" if way else "process"
        else:
            raise InputInvalid(
                "isolate", f"no component {name!r}",
                f"{expected_names(name, paths)}, * for all, or {WASM} for all as WebAssembly",
            )  # fmt: skip
    return found | own
