"""Permissions of Foxglove's clients, which have neither token nor login."""

from __future__ import annotations

from typing import NamedTuple

from uuvsim_cosim.bridge.access.access_file import LOOPBACK, is_loopback
from uuvsim_cosim.bridge.access.transports import ServerSettings
from uuvsim_cosim.errors import InputInvalid

__all__ = ["Permissions", "foxglove_permissions"]


class Permissions(NamedTuple):
    """Addresses, the calls that clients may make, why they may not make others, and PEM files."""

    hosts: tuple[str, ...] = LOOPBACK[:1]
    allowed: frozenset[str] = frozenset({"read", "set", "step"})
    reason: str = ""
    certificate: bytes | None = None
    key: bytes | None = None


def foxglove_permissions(settings: ServerSettings) -> Permissions:
    """Return the permissions by the settings of the other servers.

    Only without any authentication may clients set and step. Otherwise they may read: any program
    and any web page in a browser of this machine can connect, since the server cannot check the
    origin of a connection. From other machines they may read only if the access file lets others
    read. Raises InputInvalid if it does not, or if it requires certificates of clients.
    """
    hosts = settings.zenoh_hosts
    if settings.authenticator is None:
        return Permissions(hosts)
    if settings.authenticator.access.token is not None:
        reason = "Foxglove's clients have no token; they may only read without --anyone"
        return Permissions(hosts, frozenset({"read"}), reason)
    access = settings.authenticator.access
    far = [host for host in hosts if not is_loopback(host)]
    if far and "read" not in access.anonymous:
        raise InputInvalid(
            f"--foxglove at {', '.join(far)}",
            "Foxglove's clients cannot log in, and the access file does not let others read",
            "an address of this machine by --host, or `anyone: observer` in the access file",
        )
    if far and access.tls is not None and access.tls.ca is not None:
        raise InputInvalid(
            f"--foxglove at {', '.join(far)}",
            "the access file requires certificates of clients, which this server cannot check",
            "an address of this machine by --host, or tls without ca",
        )
    reason = "Foxglove's clients cannot log in; with --access they may only read"
    if access.tls is None:
        return Permissions(hosts, frozenset({"read"}), reason)
    certificate, key = access.tls.certificate.read_bytes(), access.tls.key.read_bytes()
    return Permissions(hosts, frozenset({"read"}), reason, certificate, key)
