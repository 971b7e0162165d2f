"""Keys under which a co-simulation and its remote components are reached over Zenoh.

    uuvsim/<system>/call/<name>                 a call of the service (a query)
    uuvsim/<system>/certificate/<name>          join with the TLS certificate of this common name
    uuvsim/<system>/state/<component>           the outputs of a component (published)
    uuvsim/<system>/live/master                 liveliness: the co-simulation runs
    uuvsim/<system>/live/component/<component>  liveliness: this component takes part
    uuvsim/<system>/live/client/<id>            liveliness: this client is connected
    uuvsim-component/<name>/<call>              a call of a remote component; `live`: liveliness

Where a part is left out, the key is a pattern for all of them.
"""

from __future__ import annotations

__all__ = [
    "call_key",
    "certificate_key",
    "client_key",
    "component_key",
    "master_key",
    "remote_component_key",
    "state_key",
]


def call_key(system: str = "*", name: str = "*") -> str:
    """Return the key of a call."""
    return f"uuvsim/{system}/call/{name}"


def certificate_key(system: str = "*", name: str = "*") -> str:
    """Return the key by which the owner of a certificate joins."""
    return f"uuvsim/{system}/certificate/{name}"


def state_key(system: str = "*", component: str = "*") -> str:
    """Return the key of a component's outputs."""
    return f"uuvsim/{system}/state/{component}"


def master_key(system: str = "*") -> str:
    """Return the liveliness key of a co-simulation."""
    return f"uuvsim/{system}/live/master"


def component_key(system: str, component: str) -> str:
    """Return the liveliness key of a component."""
    return f"uuvsim/{system}/live/component/{component}"


def client_key(system: str = "*", client: str = "*") -> str:
    """Return the liveliness key of a client."""
    return f"uuvsim/{system}/live/client/{client}"


def remote_component_key(name: str = "*", call: str = "*") -> str:
    """Return the key of a call of a remote component, or of its liveliness (`live`)."""
    return f"uuvsim-component/{name}/{call}"
