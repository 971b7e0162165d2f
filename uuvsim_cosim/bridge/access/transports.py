"""The configuration that all servers of a co-simulation share: addresses, authentication, TLS."""

from __future__ import annotations

import ssl
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from uuvsim_cosim.bridge.access.access_file import LOOPBACK, Access, is_loopback, read_access
from uuvsim_cosim.bridge.access.authentication import Admission, Authenticator, everybody
from uuvsim_cosim.bridge.access.tls import server_context
from uuvsim_cosim.bridge.access.token import guarded_by_token
from uuvsim_cosim.errors import InputInvalid

__all__ = ["ServerSettings", "server_settings"]


@dataclass(frozen=True)
class ServerSettings:
    """Addresses and authentication of the servers; without `authenticator` all is allowed."""

    hosts: tuple[str, ...]
    authenticator: Authenticator | None

    @property
    def admit(self) -> Admission:
        """The function that authenticates a client."""
        return self.authenticator or everybody

    @property
    def tls(self) -> ssl.SSLContext | None:
        """The context of a server; None without TLS."""
        tls = None if self.authenticator is None else self.authenticator.access.tls
        return None if tls is None else server_context(tls)

    @property
    def zenoh_hosts(self) -> tuple[str, ...]:
        """Addresses for Zenoh, which refuses one that the machine does not have, such as ::1."""
        return self.hosts if self.hosts != LOOPBACK else LOOPBACK[:1]

    @property
    def summary(self) -> str:
        """Who has access, in one line."""
        if self.authenticator is None:
            return "to everybody who can reach it, with all permissions"
        access = self.authenticator.access
        if access.token is not None:
            return "on this machine to programs of this user"
        roles = {} if access.tls is None else access.tls.roles
        named = [f"{user.name} ({user.role})" for user in access.users.values()]
        named += [f"certificate {name} ({role})" for name, role in roles.items()]
        return "to " + ", ".join([*named, f"others: {access.anyone or 'nothing'}"])


def server_settings(
    access: str | Path | None = None, hosts: Sequence[str] = (), *, anyone: bool = False
) -> ServerSettings:
    """Read an access file; raises InputInvalid for servers that would be open without protection.

    Without a file, clients need the token that only this user can read. `hosts` replace those of
    the file. `anyone` allows everything without file and token, also from other machines.
    """
    if access is not None and anyone:
        raise InputInvalid("--anyone admits everybody, but --access does not", "one")
    read: Access | None = None if access is None else read_access(access)
    chosen = tuple(dict.fromkeys(hosts)) or (read.listen if read is not None else LOOPBACK)
    far = ", ".join(host for host in chosen if not is_loopback(host))
    if far and read is None and not anyone:
        raise InputInvalid(
            (
                f"{far} is reachable from other machines, where anybody could step and change the "
                "co-simulation"
            ),
            (
                "--access FILE with users and roles (see "
                "docs/connections/security.md), or --anyone to admit everybody"
            ),
        )
    if far and read is not None and read.tls is None and not read.plain:
        raise InputInvalid(
            (
                f"{far} is reachable from other machines, and {access} has no tls, so that others "
                "in the network can read passwords and values"
            ),
            "tls in that file, or `tls: none` to allow this",
        )
    if anyone:
        return ServerSettings(chosen, None)
    return ServerSettings(chosen, guarded_by_token() if read is None else Authenticator(read))
