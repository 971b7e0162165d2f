"""A conversion of signals into one type of ROS message, and what it may depend on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from uuvsim_cosim.bridge.ros2.frames import Array

__all__ = ["ANY", "Conversion", "Shape", "Values", "diagonal"]

ANY = -1  # size of a signal that may have any number of elements

Values: TypeAlias = Mapping[str, Array]
"""Signals by their role: n rows, in the project's frames."""


@dataclass(frozen=True)
class Shape:
    """Texts and lengths of sequences in a message, by the path of the field."""

    texts: Mapping[str, str] = field(default_factory=dict)
    lengths: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Conversion:
    """Conversion into a type: the roles of its signals with their sizes, and what it computes.

    `columns` gets the signals by role, and figures of the sensor: those of `sensor_figures`, or
    with `needs`, the facts (facts.py) of the component, among which the needed ones are. A role in
    `optional` may be missing. With `prefixes`, the roles are instead ``<prefix>.<name>``, any
    number of them, whose signals have this size. `shape` returns texts and lengths of a message; if
    `has_states`, they follow from the values, and a message is sent whenever these change. With
    `lost`, there is a message, once per second, while the sensor has no valid reading.
    """

    roles: Mapping[str, int]
    columns: Callable[[Values, Any], dict[str, Array]]
    optional: frozenset[str] = frozenset()
    needs: frozenset[str] = frozenset()
    prefixes: Mapping[str, int] = field(default_factory=dict)
    shape: Callable[[Values, Any], Shape] | None = None
    has_states: bool = False
    lost: bool = False

    def size_of(self, role: str) -> int | None:
        """Return the size of a role's signal; None if there is no such role."""
        prefix, dot, name = role.partition(".")
        return self.prefixes.get(prefix) if dot and name else self.roles.get(role)


def diagonal(variances: Array) -> Array:
    """Return matrices (n, k·k), row by row, with these diagonals (n, k)."""
    n, k = variances.shape
    matrix = np.zeros((n, k, k))
    matrix[:, range(k), range(k)] = variances
    return matrix.reshape(n, k * k)
