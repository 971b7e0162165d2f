"""What a component says of its peers becomes connections when it is put into a system.

A component may name what feeds its inputs in the systems that it was made for: a path from the
top, ``target.position``. In ``tracker_{1}.hull.eta``, ``{1}`` stands for the first number, rising
from 1, that is not the number of the component's own ``tracker_2``. Such connections are written
into the system like any other; a peer that is not there leaves a remark.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from uuvsim_cosim.errors import SystemInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.system import System
    from uuvsim_cosim.orchestrator.wiring import Wire

__all__ = ["with_peers"]

_NUMBERED = re.compile(r"^(?P<stem>.*?)\{(?P<k>\d+)\}")


def with_peers(system: System, path: str) -> System:
    """Connect the inputs of the component at `path` that nothing feeds yet to their peers."""
    owner, dot, _ = path.partition(".")
    nested = system.nested_or_none(owner) if dot else None
    if nested is None and path not in system.components:
        return system
    fed = {(w.target.element, w.target.variable.name) for w in _wires(system, path)}
    element = path.rpartition(".")[2]
    for name, pattern in system.describe(path).peers.items():
        if (element, name) in fed:
            continue
        peer = _of(pattern, path)
        try:
            source, wider = _offered(system, peer)
            target, wider = _offered(wider, f"{path}.{name}")
            system = wider.connect(source, target)
        except SystemInvalid:
            remark = f"{path}.{name}: nothing feeds it; {peer} is not in this system"
            system = replace(system, remarks=(*system.remarks, remark))
    return system


def _wires(system: System, path: str) -> Sequence[Wire]:
    owner, dot, rest = path.partition(".")
    nested = system.nested_or_none(owner) if dot else None
    return system.checked.wires if nested is None else _wires(nested, rest)


def _of(pattern: str, path: str) -> str:
    """Give the peer's path: the k-th number that is not the component's own."""
    m = _NUMBERED.match(pattern)
    if m is None:
        return pattern
    own = re.match(re.escape(m["stem"]) + r"(\d+)", path)
    k = int(m["k"])
    if own is not None and int(own[1]) <= k:
        k += 1
    return f"{m['stem']}{k}{pattern[m.end() :]}"


def _offered(system: System, path: str) -> tuple[str, System]:
    """Give a connector of the system's own for one within it, exposed if need be."""
    owner, _, rest = path.partition(".")
    nested = system.nested_or_none(owner)
    if nested is None:
        return path, system
    for item in nested.exposed:
        if item.path == rest:
            return f"{owner}.{item.name}", system
    inner, nested = _offered(nested, rest)
    taken = {item.name for item in nested.exposed}
    name = rest.replace(".", "_")
    while name in taken:
        name += "_"
    return f"{owner}.{name}", system._edited(owner, nested.expose(name, inner))
