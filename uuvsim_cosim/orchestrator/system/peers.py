"""Peers: the signals that a component names as sources of its inputs.

A component may name the signals that feed its inputs in the systems that it was made for, by a path
from the top: ``target.position``. In ``tracker_{1}.hull.eta``, ``{1}`` stands for the first number,
counted from 1, that is not the number of the component's own ``tracker_2``. `System.replace`
connects these signals; if the system does not have one, a remark says so.
"""

from __future__ import annotations

import re

__all__ = ["peer_of"]

_NUMBERED = re.compile(r"^(?P<stem>.*?)\{(?P<k>\d+)\}")


def peer_of(pattern: str, path: str) -> str:
    """Return the path of the peer of the component at `path`: {k} becomes a number."""
    m = _NUMBERED.match(pattern)
    if m is None:
        return pattern
    own = re.match(re.escape(m["stem"]) + r"(\d+)", path)
    k = int(m["k"])
    if own is not None and int(own[1]) <= k:
        k += 1
    return f"{m['stem']}{k}{pattern[m.end() :]}"
