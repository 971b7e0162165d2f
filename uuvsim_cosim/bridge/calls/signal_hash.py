"""The content hash of a set of signals: a client detects that it was made for other signals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from uuvsim_cosim.bridge.calls.service import SignalInfo
from uuvsim_cosim.cache import content_hash

__all__ = ["entry", "interface_hash"]


def entry(info: SignalInfo) -> Mapping[str, object]:
    """Return the entry of a signal in a layout."""
    return {"name": info.name, "type": info.type, "shape": list(info.shape)}


def interface_hash(inputs: Iterable[SignalInfo], outputs: Iterable[SignalInfo]) -> str:
    """Hash names, types, shapes and units, in this order."""
    parts = []
    for what, infos in (("inputs", inputs), ("outputs", outputs)):
        parts.append(what)
        parts += [repr((i.name, i.type, tuple(i.shape), i.unit)) for i in infos]
    return content_hash(parts)
