"""Spare instances of an FMU that cannot copy its state: each reset uses the next one.

A further instance neither unpacks the archive nor loads the library again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import final

from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.importer.fmu_binary import FmuBinary
from uuvsim_cosim.fmus.model_exchange.component import ModelExchange

__all__ = ["InstancePool", "is_pooled"]


def is_pooled(component: Component) -> bool:
    """Return whether a reset replaces the component: an FMU of this process without states.

    Python classes and isolated components have a `reset` that restores their initial state.
    """
    able = component.description.can_get_and_set_state
    return not able and isinstance(component, FmuBinary | ModelExchange)


@final
class InstancePool:
    """Instances of one component, also made in advance for the resets that will need them."""

    def __init__(self, make: Callable[[], Component]) -> None:
        self._make = make
        self._spare: list[Component] = []

    def __len__(self) -> int:
        """Return the number of spare instances."""
        return len(self._spare)

    def fill(self, n: int, component: Component) -> None:
        """Make instances until n are spare; none if the FMU can be instantiated only once."""
        if component.description.can_be_instantiated_only_once:
            return
        while len(self._spare) < n:
            self._spare.append(self._make())

    def exchange(self, used: Component) -> Component:
        """Free a used instance, and return a new one."""
        used.free()
        return self._spare.pop() if self._spare else self._make()

    def free(self) -> None:
        """Free the spare instances."""
        while self._spare:
            self._spare.pop().free()
