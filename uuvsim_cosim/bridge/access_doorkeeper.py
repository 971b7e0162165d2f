"""At every door the same doorkeeper says what a client may do, or in words why it may not enter."""

from __future__ import annotations

import hmac
import secrets
import threading
import time
from typing import Protocol, final

from uuvsim_cosim.bridge.access import Access
from uuvsim_cosim.bridge.access_passwords import hashed, matches
from uuvsim_cosim.bridge.roles import permissions
from uuvsim_cosim.errors import InputInvalid

__all__ = ["Admission", "Doorkeeper", "everybody"]

_BURST, _RATE = 5, 0.5  # wrong passwords: so many at once, then so many a second, for each name
_REMEMBERED = 256  # right passwords that need no scrypt again, as HTTP repeats them


class Admission(Protocol):
    """Gives what a client may do; raises UuvsimError in words for who may not enter."""

    def __call__(
        self, user: str | None, password: str | None, certificate: str | None = None, /
    ) -> frozenset[str]:
        """`certificate` is the common name of one that TLS has verified."""


def everybody(
    user: str | None, password: str | None, certificate: str | None = None, /
) -> frozenset[str]:
    """Let everybody do everything; fit for loopback only."""
    return permissions("owner")


@final
class Doorkeeper:
    """The `Admission` of an access file; `clock` gives seconds."""

    def __init__(self, access: Access, clock: object = None) -> None:
        self.access = access
        self._clock = clock if callable(clock) else time.monotonic
        self._lock = threading.Lock()
        self._secret = secrets.token_bytes(32)
        self._right: dict[bytes, str] = {}
        self._wrong: dict[str, tuple[float, float]] = {}  # name: (tries left, when)
        self._nobody = hashed(secrets.token_hex(16))

    def __call__(
        self, user: str | None, password: str | None, certificate: str | None = None, /
    ) -> frozenset[str]:
        """Give what a client may do; raises InputInvalid in words for who may not enter."""
        access = self.access
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

    def _known(self, name: str, password: str) -> frozenset[str]:
        user = self.access.users.get(name)
        mark = hmac.digest(self._secret, f"{name}\0{password}".encode("utf-8", "replace"), "sha256")
        with self._lock:  # one scrypt at a time: a flood of tries takes one core at most
            if user is not None and self._right.get(mark) == user.password:
                return permissions(user.role)
            self._check_tries(name if user is not None else "")
            right = matches(password, self._nobody if user is None else user.password)
            if user is None or not right:
                self._count(name if user is not None else "")
                raise InputInvalid(
                    f"user {name[:64]!r} or the password is wrong; expected those of who serves"
                )
            if len(self._right) >= _REMEMBERED:
                self._right.clear()
            self._right[mark] = user.password
        return permissions(user.role)

    def _left(self, name: str) -> float:
        left, then = self._wrong.get(name, (float(_BURST), 0.0))
        return min(float(_BURST), left + (self._clock() - then) * _RATE)

    def _check_tries(self, name: str) -> None:
        left = self._left(name)
        if left < 1.0:
            pause = (1.0 - left) / _RATE
            raise InputInvalid(f"too many wrong passwords; expected to wait {pause:.0f} s")

    def _count(self, name: str) -> None:
        self._wrong[name] = (self._left(name) - 1.0, self._clock())
