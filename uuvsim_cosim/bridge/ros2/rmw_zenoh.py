"""Keys, tokens and attachments by which rmw_zenoh finds and reads topics of ROS 2.

A topic's data has the key ``<domain>/<topic>/<pkg>::msg::dds_::<Type>_/<type hash>``. Nodes and
publishers are announced by liveliness tokens, whose key holds, with % for each slash,

    @ros2_lv/<domain>/<session>/<node id>/<own id>/<kind>/%/<namespace>/<node>/<topic>/<type>/
    <hash>/<QoS>

QoS is reliability:durability:history,depth:deadline:lifespan:liveliness, and a part that equals the
default (reliable, volatile, keep last 42) is empty. Services have keys and tokens of the same form,
with ``srv`` in the place of ``msg``; a request is a query, and its reply carries the request's
number and GID. With each message travel its number from 1, its
time [ns] and the publisher's GID (16 bytes), which is the XXH3-128 of its token, low half first.
Source: rmw_zenoh_cpp, docs/design.md and src/detail/liveliness_utils.cpp.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

__all__ = [
    "DEFAULT", "KEEP_10", "Entity", "attachment", "gid", "namesakes",
    "node_token", "qos_text", "read_attachment", "topic_key", "topic_token",
]  # fmt: skip

DEFAULT = "::,:,:,:,,"  # QoS of a publisher
KEEP_10 = "::,10:,:,:,,"  # of subscriptions and services
_DEPTH = 42  # the default
_ATTACHMENT = struct.Struct("<qqB16s")


@dataclass(frozen=True)
class Entity:
    """A node, and the session and domain it is in; `namespace` is empty or begins with /."""

    name: str
    session: str
    namespace: str = ""
    domain: int = 0


def qos_text(*, best_effort: bool, transient_local: bool, depth: int) -> str:
    """Return a quality of service as it stands in tokens; depth 0 is the default."""
    kept = depth if depth != _DEPTH else 0
    return f"{'2' if best_effort else ''}:{'1' if transient_local else ''}:,{kept or ''}:,:,:,,"


def node_token(node: Entity) -> str:
    """Return the token of a node."""
    place = _mangled(node.namespace)
    return f"@ros2_lv/{node.domain}/{node.session}/0/0/NN/%/{place}/{node.name}"


def namesakes(node: Entity) -> str:
    """Return the key of the tokens of all nodes with a node's name, its own among them."""
    return f"@ros2_lv/{node.domain}/*/*/*/NN/*/{_mangled(node.namespace)}/{node.name}"


def topic_token(
    node: Entity, number: int, topic: str, type_: str, hash_: str, *, qos: str = DEFAULT,
    kind: str = "MP",
) -> str:  # fmt: skip
    """Return the token of an entity with a number of its own from 1.

    The `kind` is that of a publisher (MP), a subscription (MS), or a service's server (SS).
    """
    return (
        f"@ros2_lv/{node.domain}/{node.session}/0/{number}/{kind}/%/{_mangled(node.namespace)}/"
        f"{node.name}/{_mangled(topic)}/{_dds(type_)}/{hash_}/{qos}"
    )


def topic_key(domain: int, topic: str, type_: str, hash_: str) -> str:
    """Return the key of a topic's data, or of a service's requests."""
    return f"{domain}/{topic.strip('/')}/{_dds(type_)}/{hash_}"


def gid(token: str) -> bytes:
    """Return the 16 bytes that identify the publisher of a token."""
    import xxhash

    whole = xxhash.xxh3_128_intdigest(token.encode())
    return struct.pack("<QQ", whole & (2**64 - 1), whole >> 64)


def attachment(number: int, time: int, gid_: bytes) -> bytes:
    """Return what travels with a message: its number, its time [ns], and its publisher."""
    return struct.pack("<qqB", number, time, len(gid_)) + gid_


def read_attachment(data: bytes) -> tuple[int, int, bytes] | None:
    """Return number, time [ns] and GID; None for bytes that are no attachment."""
    if len(data) != _ATTACHMENT.size:
        return None
    number, time, length, gid_ = _ATTACHMENT.unpack(data)
    return (number, time, gid_) if length == len(gid_) else None


def _mangled(name: str) -> str:
    return name.replace("/", "%") or "%"


def _dds(type_: str) -> str:
    package, middle, name = type_.split("/")
    return f"{package}::{middle}::dds_::{name}_"
