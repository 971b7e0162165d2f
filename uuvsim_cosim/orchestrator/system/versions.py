"""Mapping whose versions share their items, so that a system of n components is built in O(n)."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from itertools import islice
from threading import Lock
from typing import Generic, TypeVar

__all__ = ["Versions"]

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")
_extending = Lock()


class Versions(Mapping[Key, Value], Generic[Key, Value]):
    """Immutable mapping; `extended` returns a longer version without a copy of the items.

    All versions share one dictionary, and each sees its first `len(self)` items. Only the newest
    version can be extended in place; an older one is copied first.
    """

    __slots__ = ("_items", "_length")

    def __init__(self, items: Mapping[Key, Value] | None = None) -> None:
        """Copy the items."""
        self._items = {k: (i, v) for i, (k, v) in enumerate((items or {}).items())}
        self._length = len(self._items)

    def __getitem__(self, key: Key) -> Value:
        """Return the value of a key."""
        index, value = self._items[key]
        if index >= self._length:
            raise KeyError(key)
        return value

    def __iter__(self) -> Iterator[Key]:
        """Iterate over the keys in the order in which they were added."""
        return islice(iter([*self._items]), self._length)

    def __len__(self) -> int:
        """Return the number of items."""
        return self._length

    def index(self, key: Key) -> int:
        """Return the number of keys that were added before a key."""
        self[key]
        return self._items[key][0]

    def extended(self, items: Mapping[Key, Value]) -> Versions[Key, Value]:
        """Return a version with new items at the end; none of the keys may be there already."""
        result: Versions[Key, Value] = Versions.__new__(Versions)
        with _extending:  # two threads may extend the same version
            shared = self._items
            if len(shared) != self._length:
                shared = dict(islice(shared.items(), self._length))
            for key, value in items.items():
                assert key not in shared
                shared[key] = (len(shared), value)
            result._items, result._length = shared, len(shared)
        return result
