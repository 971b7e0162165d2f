"""Content of an access file: the users, certificates and addresses of a served co-simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from uuvsim_cosim.bridge.access.roles import permissions

__all__ = ["LOOPBACK", "Access", "Tls", "User", "is_loopback"]

LOOPBACK = ("127.0.0.1", "::1")


@dataclass(frozen=True)
class User:
    """A user with a password, which is stored as a salted scrypt hash."""

    name: str
    role: str
    password: str  # scrypt$n$r$p$salt$hash


@dataclass(frozen=True)
class Tls:
    """Certificates; with `ca`, a client needs one as well (mutual TLS)."""

    certificate: Path
    key: Path
    ca: Path | None = None
    roles: Mapping[str, str] = field(default_factory=dict)  # common name: role


@dataclass(frozen=True)
class Access:
    """The content of an access file, or the token of a server that has no file."""

    users: Mapping[str, User] = field(default_factory=dict)
    tls: Tls | None = None
    anyone: str | None = None  # role of an anonymous client; None: anonymous clients are refused
    listen: tuple[str, ...] = LOOPBACK
    plain: bool = False  # passwords may cross a network without TLS
    token: str | None = None  # of a server without a file; it gives the role of the owner

    @property
    def anonymous(self) -> frozenset[str]:
        """The permissions of an anonymous client."""
        return frozenset() if self.anyone is None else permissions(self.anyone)


def is_loopback(host: str) -> bool:
    """Return whether an address can be reached from this machine only."""
    import ipaddress

    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"
