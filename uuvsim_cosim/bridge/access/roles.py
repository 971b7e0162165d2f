"""Roles and their permissions: each call needs one permission, or none."""

from __future__ import annotations

from uuvsim_cosim.bridge.calls.call_table import CALLS
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["NEEDS", "ROLES", "check", "permissions"]

# Call -> the permission that it needs; calls that are not listed need none.
NEEDS = {name: call.needs for name, call in CALLS.items() if call.needs is not None}
ROLES: dict[str, frozenset[str]] = {
    "observer": frozenset({"read"}),
    "operator": frozenset({"read", "set"}),
    "controller": frozenset({"read", "set", "step"}),
    "owner": frozenset({"read", "set", "step", "manage"}),
}


def permissions(role: str) -> frozenset[str]:
    """Return the permissions of a role; raises InputInvalid for an unknown one."""
    if role not in ROLES:
        raise InputInvalid(f"role {role!r}", expected_names(role, ROLES))
    return ROLES[role]


def check(client: Client, call: str) -> None:
    """Refuse a call that the client's role does not allow."""
    needed = NEEDS.get(call)
    if needed is None or needed in client.allowed:
        return
    may = ", ".join(sorted(client.allowed)) or "nothing"
    allows = [role for role, allowed in ROLES.items() if needed in allowed]
    raise InputInvalid(
        call,
        f"client {client.name!r} may {may}, but this call needs {needed!r}",
        f"a role such as {allows[0]}",
    )
