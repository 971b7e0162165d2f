"""Authentication for every transport: the permissions of a client, or the reason of a refusal."""

from __future__ import annotations

import hmac
import secrets
import threading
from collections.abc import Callable
from typing import final

from uuvsim_cosim.bridge.access.access_file import Access
from uuvsim_cosim.bridge.access.passwords import hashed, matches
from uuvsim_cosim.bridge.access.roles import permissions
from uuvsim_cosim.errors import InputInvalid

__all__ = ["Admission", "Authenticator", "everybody"]

_REMEMBERED = 256  # correct passwords that skip scrypt: HTTP sends them with each request


Admission = Callable[[str | None, str | None, str | None, str | None], frozenset[str]]
"""A function that returns the permissions of a client; raises UuvsimError to refuse it.

Its arguments are the user, the password, the common name of a certificate that TLS has verified,
and the token, each None if the client has not sent it.
"""


def everybody(*credentials: str | None) -> frozenset[str]:
    """Allow everything, which includes running code as the user who runs the server."""
    return permissions("owner")


@final
class Authenticator:
    """The `Admission` of an access file or a token; `place` is the folder of the token.

    There is no limit of failed attempts, so that nobody can lock a user out. Guessing is limited
    because only one password is checked at a time, in about 40 ms each.
    """

    def __init__(self, access: Access, *, place: str = "") -> None:
        self.access = access
        self._place = place
        self._lock = threading.Lock()
        self._secret = secrets.token_bytes(32)
        self._right: dict[bytes, str] = {}
        # Checked for an unknown user, so that the time of the answer does not reveal the users.
        hashes = [user.password for user in access.users.values()]
        self._nobody = hashes[0] if hashes else hashed(secrets.token_hex(16))

    def __call__(
        self,
        user: str | None,
        password: str | None,
        certificate: str | None = None,
        token: str | None = None,
        /,
    ) -> frozenset[str]:
        """Return the permissions of a client; raises InputInvalid to refuse it."""
        access = self.access
        if access.token is not None:
            given = (token or "").encode("utf-8", "replace")
            if hmac.compare_digest(given, access.token.encode()):
                return permissions("owner")
            read = "the token is wrong" if token else "this co-simulation requires a token"
            raise InputInvalid(
                f"{read}. Programs of the server's user find it in {self._place}; other programs "
                "pass it as token= or in the environment variable UUVSIM_TOKEN"
            )
        mutual = access.tls is not None and access.tls.ca is not None
        if mutual and certificate is None:
            raise InputInvalid(
                "this co-simulation requires a certificate", "one that its CA has signed"
            )
        if user is not None:
            return self._by_password(user, password or "")
        role = None if access.tls is None else access.tls.roles.get(certificate or "")
        if role is not None:
            return permissions(role)
        if access.anyone is not None:
            return access.anonymous
        if mutual and not access.users:
            raise InputInvalid(
                f"the certificate {certificate or 'of this client'!s} has no role in the access "
                "file",
                "one whose common name is under tls, roles in the access file",
            )
        raise InputInvalid("this co-simulation requires a login", "user and password")

    def _by_password(self, name: str, password: str) -> frozenset[str]:
        user = self.access.users.get(name)
        mark = hmac.digest(self._secret, f"{name}\0{password}".encode("utf-8", "replace"), "sha256")
        if user is not None and self._right.get(mark) == user.password:
            return permissions(user.role)
        with self._lock:  # one scrypt at a time: many attempts use one core at most
            is_right = matches(password, self._nobody if user is None else user.password)
            if user is None or not is_right:
                raise InputInvalid(
                    f"user {name[:64]!r} or the password is wrong", "those in the access file"
                )
            if len(self._right) >= _REMEMBERED:
                self._right.clear()
            self._right[mark] = user.password
        return permissions(user.role)
