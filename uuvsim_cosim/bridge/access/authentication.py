"""Authentication, the same for every transport: what a client may do, or why it is refused."""

from __future__ import annotations

import hmac
import secrets
import threading
from typing import Protocol, final

from uuvsim_cosim.bridge.access.access_file import Access
from uuvsim_cosim.bridge.access.passwords import hashed, matches
from uuvsim_cosim.bridge.access.roles import permissions
from uuvsim_cosim.errors import InputInvalid

__all__ = ["Admission", "Authenticator", "everybody"]

_REMEMBERED = 256  # right passwords that need no scrypt again, as HTTP repeats them


class Admission(Protocol):
    """Gives what a client may do; raises UuvsimError in words for who may not enter."""

    def __call__(
        self,
        user: str | None,
        password: str | None,
        certificate: str | None = None,
        token: str | None = None,
        /,
    ) -> frozenset[str]:
        """`certificate` is the common name of one that TLS has verified."""


def everybody(
    user: str | None,
    password: str | None,
    certificate: str | None = None,
    token: str | None = None,
    /,
) -> frozenset[str]:
    """Let everybody do everything, which includes running code as the user who serves."""
    return permissions("owner")


@final
class Authenticator:
    """The `Admission` of an access file or a token; `place` says where the token is.

    A right password is accepted whatever others have tried before, so that nobody can lock a user
    out. What limits guessing is that one password is checked at a time, in about 40 ms each.
    """

    def __init__(self, access: Access, *, place: str = "") -> None:
        self.access = access
        self._place = place
        self._lock = threading.Lock()
        self._secret = secrets.token_bytes(32)
        self._right: dict[bytes, str] = {}
        # Checked for a name that is not known, so that its answer takes as long as a user's.
        held = [user.password for user in access.users.values()]
        self._nobody = held[0] if held else hashed(secrets.token_hex(16))

    def __call__(
        self,
        user: str | None,
        password: str | None,
        certificate: str | None = None,
        token: str | None = None,
        /,
    ) -> frozenset[str]:
        """Return what a client may do; raises InputInvalid in words for who may not enter."""
        access = self.access
        if access.token is not None:
            return self._with_token(access.token, token)
        mutual = access.tls is not None and access.tls.ca is not None
        if mutual and certificate is None:
            raise InputInvalid(
                "this co-simulation asks for a certificate; expected one that its CA has signed"
            )
        if user is not None:
            return self._known(user, password or "")
        role = None if access.tls is None else access.tls.roles.get(certificate or "")
        if role is not None:
            return permissions(role)
        if access.anyone is not None:
            return access.anonymous
        if mutual and not access.users:
            raise InputInvalid(
                f"the certificate {certificate or 'of this client'!s} has no "
                "role here; expected one whose common name the access file has under tls, roles"
            )
        raise InputInvalid("this co-simulation asks who you are; expected user and password")

    def _with_token(self, expected: str, shown: str | None) -> frozenset[str]:
        given = (shown or "").encode("utf-8", "replace")
        if hmac.compare_digest(given, expected.encode()):
            return permissions("owner")
        read = "the token is wrong" if shown else "this co-simulation requires a token"
        raise InputInvalid(
            f"{read}. Programs of the user who serves find it in {self._place}; other programs "
            "pass it as token= or in the environment variable UUVSIM_TOKEN"
        )

    def _known(self, name: str, password: str) -> frozenset[str]:
        user = self.access.users.get(name)
        mark = hmac.digest(self._secret, f"{name}\0{password}".encode("utf-8", "replace"), "sha256")
        if user is not None and self._right.get(mark) == user.password:
            return permissions(user.role)
        with self._lock:  # one scrypt at a time: a flood of tries takes one core at most
            right = matches(password, self._nobody if user is None else user.password)
            if user is None or not right:
                raise InputInvalid(
                    f"user {name[:64]!r} or the password is wrong; expected those of who serves"
                )
            if len(self._right) >= _REMEMBERED:
                self._right.clear()
            self._right[mark] = user.password
        return permissions(user.role)
