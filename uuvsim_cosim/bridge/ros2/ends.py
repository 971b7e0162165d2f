"""The node's ends: what its publishers, subscriptions and services share."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, final

from uuvsim_cosim.bridge.ros2.rmw_zenoh import DEFAULT, Entity, topic_key, topic_token
from uuvsim_cosim.bridge.zenoh.session import WrappedSession

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

__all__ = ["Ends", "Reports"]


@final
class Reports:
    """Faults that the node has noticed: each kind of fault is reported once for each place."""

    def __init__(self, show: Callable[[str], None]) -> None:
        self._show = show
        self._known: set[tuple[str, str]] = set()
        self.texts: list[str] = []

    def once(self, place: str, fault: str, text: object) -> None:
        """Report a fault of a place, if none of its kind was reported there."""
        if (place, fault) not in self._known:
            self._known.add((place, fault))
            self.put(f"{place}: {text}")

    def put(self, text: str) -> None:
        """Report a text."""
        self.texts.append(text)
        self._show(text)


@dataclass(frozen=True)
class Ends:
    """Session, node, messages of the distribution, and reports; each end has its own number."""

    session: WrappedSession
    store: Typestore
    node: Entity
    hashed: bool  # False in humble, whose types have no hash
    reports: Reports
    _numbers: Iterator[int] = field(default_factory=lambda: itertools.count(1))

    def hash_of(self, type_: str) -> str:
        """Return the hash of a type, as it stands in keys."""
        return self.store.hash_rihs01(type_) if self.hashed else "TypeHashNotSupported"

    def key(self, name: str, type_: str) -> str:
        """Return the key of a topic's data, or of a service's requests."""
        return topic_key(self.node.domain, name, type_, self.hash_of(type_))

    def token(self, kind: str, name: str, type_: str, qos: str = DEFAULT) -> str:
        """Return the token of a new end of the node: MP, MS or SS."""
        number, hash_ = next(self._numbers), self.hash_of(type_)
        return topic_token(self.node, number, name, type_, hash_, qos=qos, kind=kind)
