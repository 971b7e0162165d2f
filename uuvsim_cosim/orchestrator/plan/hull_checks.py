"""Closed-form checks of a user's own hulls before a run: possible inertia, damping that brakes.

A hull that violates one of them still flies, but its motion is not that of a body in water. The
complete list is that of `uuvsim models check`.
"""

from __future__ import annotations

from collections.abc import Iterable

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.models.declaration.files_read import kept_until_changed
from uuvsim_cosim.models.declaration.parameter_files import (
    parameter_set,
    split_address,
    vehicle_ids,
)
from uuvsim_cosim.orchestrator.plan.plan import PlannedComponent

__all__ = ["hull_warnings"]

MEANING = {  # of a failed check
    "inertia is of a body": "a principal moment of inertia exceeds the sum of the other two",
    "water takes energy only": "the still water drives the hull, as negative damping does",
}


def hull_warnings(components: Iterable[PlannedComponent]) -> list[str]:
    """Return a sentence for each check that a hull of the user's own does not pass."""
    found: dict[str, None] = {}
    for c in components:
        address = c.description.made_for.get("hull", "") if c.source.startswith("model:") else ""
        if address and split_address(address)[0] not in vehicle_ids():
            found |= dict.fromkeys(_failed(address))
    return list(found)


@kept_until_changed
def _failed(address: str) -> tuple[str, ...]:
    from uuvsim_cosim.models.checks.checks import checks_of  # it imports CasADi

    id, name = split_address(address)
    try:
        done = list(checks_of(f"{id}@{parameter_set(id, name).name}", {"closed_form"}))
    except UuvsimError:  # the vehicle's other files have mistakes, which this hull does not use
        return ()
    return tuple(
        f"{c.address}: the check {c.what!r} fails: {MEANING[c.what]} (deviation {c.off:.3g}, "
        f"at most {c.tolerance:g}); see `uuvsim models check {id}`"
        for c in done
        if c.what in MEANING and c.verdict == "FAILS"
    )
