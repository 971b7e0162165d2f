"""Servers and clients to read, set and step a running co-simulation from other programs.

Transports are Zenoh (`zenoh/`), TCP for MATLAB and Octave (`tcp/`) and HTTP (`http/`); the Python
clients and remote components are in `clients/`, tokens and users in `access/`. `autopilots/` runs
ArduSub and PX4 as components, `mavlink/` makes a system speak like ArduSub, `ros2/` makes it a node
of ROS 2 and records its topics, `foxglove/` shows it in Foxglove. It may import `orchestrator`,
`fmus`, `models`. Start with `server/conductor.py`, then `zenoh/bridge.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from uuvsim_cosim.lazy import lazy

if TYPE_CHECKING:
    from uuvsim_cosim.bridge.clients.async_client import connect_async
    from uuvsim_cosim.bridge.clients.client import connect
    from uuvsim_cosim.bridge.clients.remote import serve_component
    from uuvsim_cosim.bridge.zenoh.bridge import Bridge

__all__ = [
    "Bridge",
    "connect",
    "connect_async",
    "serve_component",
]

__getattr__, __dir__ = lazy(
    __name__,
    {
        "Bridge": "zenoh.bridge",
        "connect": "clients.client",
        "connect_async": "clients.async_client",
        "serve_component": "clients.remote",
    },
)
