"""Slots of controllers, for which a template holds a control law that works."""

from __future__ import annotations

from uuvsim_cosim.orchestrator.system.slot import Slot

__all__ = ["is_controller"]


def is_controller(slot: Slot) -> bool:
    """Return whether the slot has a controller's connectors: eta_d, eta, nu -> tau_d."""
    inputs = {c.name for c in slot.connectors if c.direction == "input" and c.shape == (6,)}
    outputs = [c.name for c in slot.connectors if c.direction == "output"]
    return {"eta_d", "eta", "nu"} <= inputs and outputs == ["tau_d"]
