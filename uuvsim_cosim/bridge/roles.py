"""What a client may do follows from its role: each call needs one permission."""

from __future__ import annotations

from difflib import get_close_matches

from uuvsim_cosim.bridge.desk import Client
from uuvsim_cosim.errors import InputInvalid

__all__ = ["NEEDS", "ROLES", "check", "permissions"]

# Call -> the permission that it needs; what is not listed needs none.
NEEDS = {
    "get": "read",
    "set": "set",
    "step": "step",
    "run": "step",
    "pause": "step",
    "reset": "step",
    "snapshot": "step",
    "restore": "step",
    "replace": "manage",
}
ROLES: dict[str, frozenset[str]] = {
    "observer": frozenset({"read"}),
    "operator": frozenset({"read", "set"}),
    "controller": frozenset({"read", "set", "step"}),
    "owner": frozenset({"read", "set", "step", "manage"}),
}


def permissions(role: str) -> frozenset[str]:
    """Give what a role allows; raises InputInvalid for an unknown one."""
    if role not in ROLES:
        near = get_close_matches(role, ROLES, 1) or list(ROLES)
        raise InputInvalid(f"role {role!r}; expected one of {', '.join(near)}")
    return ROLES[role]


def check(client: Client, call: str) -> None:
    """Refuse a call that the client's role does not allow."""
    needed = NEEDS.get(call)
    if needed is None or needed in client.allowed:
        return
    may = ", ".join(sorted(client.allowed)) or "nothing"
    allows = [role for role, allowed in ROLES.items() if needed in allowed]
    raise InputInvalid(
        f"{call}: client {client.name!r} may {may}, and this needs {needed!r}; expected a role "
        f"such as {allows[0]}"
    )
