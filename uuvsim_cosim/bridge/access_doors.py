"""What all doors of one co-simulation open with: addresses, the doorkeeper, and TLS."""

from __future__ import annotations

import ssl
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from uuvsim_cosim.bridge.access import LOOPBACK, Access, is_loopback
from uuvsim_cosim.bridge.access_doorkeeper import Admission, Doorkeeper, everybody
from uuvsim_cosim.bridge.access_text import read_access
from uuvsim_cosim.bridge.access_tls import server_context
from uuvsim_cosim.errors import InputInvalid

__all__ = ["Opening", "opening"]


@dataclass(frozen=True)
class Opening:
    """Where doors listen, and who may enter; without `keeper` everybody may do everything."""

    hosts: tuple[str, ...]
    keeper: Doorkeeper | None

    @property
    def admit(self) -> Admission:
        """Who says what a client may do."""
        return self.keeper or everybody

    @property
    def tls(self) -> ssl.SSLContext | None:
        """A context for a door, if TLS is spoken."""
        tls = None if self.keeper is None else self.keeper.access.tls
        return None if tls is None else server_context(tls)

    @property
    def zenoh_hosts(self) -> tuple[str, ...]:
        """Where Zenoh listens: it refuses an address that a machine lacks, as ::1 may be."""
        return self.hosts if self.hosts != LOOPBACK else LOOPBACK[:1]

    @property
    def words(self) -> str:
        """Say who may enter, in a line."""
        if self.keeper is None:
            far = any(not is_loopback(host) for host in self.hosts)
            return "anybody who can reach it, who may do everything" if far else "on this machine"
        access = self.keeper.access
        roles = {} if access.tls is None else access.tls.roles
        named = [f"{user.name} ({user.role})" for user in access.users.values()]
        named += [f"certificate {name} ({role})" for name, role in roles.items()]
        return ", ".join([*named, f"others: {access.anyone or 'nothing'}"])


def opening(
    access: str | Path | None = None, hosts: Sequence[str] = (), *, anyone: bool = False
) -> Opening:
    """Read an access file; raises InputInvalid for doors that would be open unguarded.

    `hosts` stand in place of those of the file; `anyone` opens them beyond this machine without.
    """
    if access is not None and anyone:
        raise InputInvalid("--anyone lets everybody in, and --access does not; expected one")
    said: Access | None = None if access is None else read_access(access)
    chosen = tuple(dict.fromkeys(hosts)) or (said.listen if said is not None else LOOPBACK)
    far = ", ".join(host for host in chosen if not is_loopback(host))
    if far and said is None and not anyone:
        raise InputInvalid(
            f"{far} is beyond this machine, where anybody could step and change the "
            "co-simulation; expected --access FILE that says who may (see docs/security.md), or "
            "--anyone to let everybody in"
        )
    if far and said is not None and said.tls is None and not said.plain:
        raise InputInvalid(
            f"{far} is beyond this machine, and {access} has no tls, so that passwords and values "
            "can be read on the way; expected tls there, or `tls: none` to do it nevertheless"
        )
    return Opening(chosen, None if said is None else Doorkeeper(said))
