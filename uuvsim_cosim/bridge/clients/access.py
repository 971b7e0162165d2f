"""Credentials of a client of the Zenoh server, and clear messages if it is refused."""

from __future__ import annotations

import contextlib
import socket
import ssl
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uuvsim_cosim.bridge.access.tls import client_context, common_names, why_refused
from uuvsim_cosim.bridge.access.token import known_token, token_folder
from uuvsim_cosim.bridge.access.zenoh_permissions import GUEST, client_settings
from uuvsim_cosim.bridge.calls.zenoh_keys import call_key, certificate_key
from uuvsim_cosim.bridge.zenoh.session import (
    Disconnected,
    NoSession,
    WrappedSession,
    connecting,
)
from uuvsim_cosim.errors import InputInvalid

__all__ = ["Credentials"]

Reply = tuple[dict[str, Any], dict[str, Any]]  # the fields of an answer, and its values by name


@dataclass(frozen=True)
class Credentials:
    """Credentials of a client; all are optional.

    User and password, the CA that is trusted, a certificate with its key, and the token of a
    server without an access file. Without `token`, the one in this user's token folder is used.
    """

    user: str | None = None
    password: str | None = None
    ca: str | Path | None = None
    certificate: str | Path | None = None
    key: str | Path | None = None
    token: str | None = None

    @property
    def tls(self) -> bool:
        """Whether to speak TLS."""
        return self.ca is not None or self.certificate is not None

    def opened(
        self, host: str, port: int, user: str | None = None, password: str | None = None
    ) -> WrappedSession:
        """Open a session; raises Disconnected, or InputInvalid with the reason of the refusal.

        `user` and `password` are those of Zenoh's user `reader`, which a client gets on joining.
        """
        if (self.password is not None) and self.user is None:
            raise InputInvalid("connect", "a password without user", "both")
        context = client_context(self.ca, self.certificate, self.key) if self.tls else None
        if context is not None:
            self._refuse(host, port, why_refused(host, port, context, listen=0.0))
        files = (self.ca, self.certificate, self.key)
        token = self._token(host, port)
        tries = [(user, password)] if user else [(None, None), (GUEST, GUEST)]
        if user is None and token is not None:
            tries.insert(0, (GUEST, token))
        for one in tries:
            try:
                return connecting(host, port, client_settings(*one, *files), tls=self.tls)
            except Disconnected as error:
                refused = error
        reason = why_refused(host, port, context) if context else _wants_tls(host, port)
        self._refuse(host, port, reason)
        if user is None and isinstance(refused, NoSession):
            required = "a token" if token is None else "another token than this client has"
            place = "their folder of tokens"
            with contextlib.suppress(InputInvalid):  # no home directory
                place = str(token_folder())
            raise InputInvalid(
                f"{host}, port {port}, opens no session to this client: the server requires "
                f"{required}, or this is not the port that `uuvsim serve` prints for Python. "
                "Programs of the server's user "
                f"find the token in {place}; other programs pass it as token= or in the "
                "environment variable UUVSIM_TOKEN"
            )
        raise refused

    def _token(self, host: str, port: int) -> str | None:
        return (known_token(host, port) if self.token is None else self.token) or None

    @staticmethod
    def _refuse(host: str, port: int, reason: str | None) -> None:
        if reason is not None:
            raise InputInvalid(f"connect to {host}, port {port}: {reason}")

    def join(
        self,
        ask: Callable[..., Reply],
        system: str,
        joining: dict[str, object],
        address: tuple[str, int],
    ) -> Reply:
        """Join a system by `ask(key, **fields)`: by user and password, certificate, or token."""
        token = self._token(*address)
        if token is not None:
            joining = {**joining, "token": token}
        if self.user is not None:
            joining = {**joining, "user": self.user, "password": self.password or ""}
        elif self.certificate is not None:
            for name in common_names(self.certificate):
                if "/" in name or "*" in name or not name:
                    continue  # cannot be a part of Zenoh's key
                try:  # there is no answer if the certificate has another name, or no role
                    return ask(certificate_key(system, name), **joining)
                except Disconnected:
                    continue
        return ask(call_key(system, "join"), **joining)


def _wants_tls(host: str, port: int) -> str | None:
    """Return the reason of a refusal if the server speaks TLS."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    try:
        with (
            socket.create_connection((host, port), timeout=2.0) as plain,
            context.wrap_socket(plain, server_hostname=host),
        ):
            return "it uses TLS; expected ca=, the file ca.pem of the server"
    except (OSError, ValueError):
        return None
