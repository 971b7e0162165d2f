"""Password hashes: salted scrypt, compared in constant time."""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import secrets

from uuvsim_cosim.errors import InputInvalid

__all__ = ["hashed", "is_hash", "matches"]

# 16 MiB and about 40 ms for each attempt (RFC 7914; OWASP's smallest setting has p = 5).
_N, _R, _P = 1 << 14, 8, 1
_MOST = 64 << 20  # bytes that a hash in a file may ask for
_LENGTH = 32


def hashed(password: str) -> str:
    """Return `scrypt$n$r$p$salt$hash` of a password; raises InputInvalid for an empty one."""
    if not password:
        raise InputInvalid("password", "empty", "at least one character")
    salt = secrets.token_bytes(16)
    parts = (_text(salt), _text(_derived(password, salt, _N, _R, _P)))
    return "$".join(("scrypt", str(_N), str(_R), str(_P), *parts))


def is_hash(text: object) -> bool:
    """Return whether a text is a hash in the format of `hashed`."""
    return isinstance(text, str) and _parts(text) is not None


def matches(password: str, text: str) -> bool:
    """Return whether a password matches a hash."""
    parts = _parts(text)
    if parts is None:
        return False
    n, r, p, salt, expected = parts
    return hmac.compare_digest(_derived(password, salt, n, r, p), expected)


def _parts(text: str) -> tuple[int, int, int, bytes, bytes] | None:
    """Return n, r, p, salt and hash; None for other text, and for a cost that is too large."""
    try:
        scheme, n, r, p, salt, value = text.split("$")
        cost = int(n), int(r), int(p)
        decoded = base64.b64decode(salt, validate=True), base64.b64decode(value, validate=True)
    except (ValueError, binascii.Error):
        return None
    power_of_2 = cost[0] > 1 and cost[0] & (cost[0] - 1) == 0
    fits = power_of_2 and cost[1] > 0 and 0 < cost[2] <= 16 and 128 * cost[0] * cost[1] <= _MOST
    if scheme != "scrypt" or not fits or len(decoded[0]) < 8 or len(decoded[1]) != _LENGTH:
        return None
    return *cost, *decoded


def _derived(password: str, salt: bytes, n: int, r: int, p: int) -> bytes:
    given = password.encode("utf-8", "surrogatepass")
    return hashlib.scrypt(given, salt=salt, n=n, r=r, p=p, maxmem=2 * _MOST, dklen=_LENGTH)


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode()
