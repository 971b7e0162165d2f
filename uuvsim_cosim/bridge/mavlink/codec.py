"""Messages as bytes and back, with signatures of MAVLink 2 if there is a key.

A signature is 6 bytes of SHA-256 over the key and the message; its time stamp has to grow for each
link, system and component, so that a recorded message is refused. See the section "Message Signing"
of MAVLink's guide.
"""

from __future__ import annotations

import hashlib
import hmac
import os
from collections.abc import Callable
from pathlib import Path
from time import time
from typing import Any, final

from uuvsim_cosim.errors import InputInvalid

__all__ = ["KEY", "Codec", "key_of_environment"]

KEY = "UUVSIM_MAVLINK_KEY"  # environment variable: path of the file with the pass phrase
_SIGNED_SINCE = 1420070400  # [s] 2015-01-01, from which signatures count time in units of 10 us
_LATE = 60 * 100_000  # by which the first signature of a sender may be older than this clock
_PARSERS, _STREAMS = 16, 256  # senders that are told apart at most


def key_of_environment() -> bytes | None:
    """Return the key, the SHA-256 of the pass phrase in the file that UUVSIM_MAVLINK_KEY names.

    Without the variable it is None; raises InputInvalid if the file is missing or empty.
    """
    path = os.environ.get(KEY)
    if not path:
        return None
    try:
        phrase = Path(path).read_bytes().strip()
    except OSError:
        phrase = b""
    if not phrase:
        raise InputInvalid(
            KEY, f"{path} is no file with a pass phrase", "one that the other end knows too"
        )
    return hashlib.sha256(phrase).digest()


@final
class Codec:
    """The messages of one end, which has a system id and a component id.

    With a `key`, sent messages are signed, and messages without a valid signature are dropped; the
    first of them is reported by a text.
    """

    def __init__(
        self,
        mav: Any,
        system: int,
        component: int,
        key: bytes | None = None,
        report: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._mav, self._key, self._report = mav, key, report
        self._parsers: dict[Any, Any] = {}  # by peer
        self._stamps: dict[tuple[int, int, int], int] = {}  # link, system, component
        self.refused = 0  # messages without a valid signature
        self._packer = mav.MAVLink(None, srcSystem=system, srcComponent=component)
        if key is not None:
            self._packer.signing.secret_key = key
            self._packer.signing.link_id = component & 0xFF
            self._packer.signing.sign_outgoing = True

    def packed(self, message: Any) -> bytes:
        """Return a message as bytes."""
        if self._key is not None:
            signing = self._packer.signing
            signing.timestamp = max(signing.timestamp, _now())
        data = bytes(message.pack(self._packer))
        self._packer.seq = (self._packer.seq + 1) % 256
        return data

    def parsed(self, peer: Any, data: bytes) -> list[Any]:
        """Return the complete messages of a peer; bytes that are none are skipped."""
        parser = self._parsers.get(peer)
        if parser is None:
            if len(self._parsers) >= _PARSERS:
                self._parsers.clear()
            parser = self._parsers[peer] = self._mav.MAVLink(None)
            parser.robust_parsing = True
            if self._key is not None:
                parser.signing.secret_key = self._key
                parser.check_signature = self._is_signed
        found = parser.parse_buffer(data) or []
        good = [m for m in found if m.get_type() != "BAD_DATA"]
        if self._key is not None:
            wrong = sum(getattr(m, "reason", "") == "Invalid signature" for m in found)
            if wrong and not self.refused:
                self._report("MAVLink: messages without a valid signature are refused")
            self.refused += wrong
        return good

    def _is_signed(self, data: Any, system: int, component: int) -> bool:
        """Check a signature first, then its time: a forged message must not move the time."""
        assert self._key is not None
        signature = hashlib.sha256(self._key + bytes(data[:-6])).digest()[:6]
        if not hmac.compare_digest(signature, bytes(data[-6:])):
            return False
        stamp = int.from_bytes(data[-12:-6], "little")
        stream = (data[-13], system, component)
        if stamp <= self._stamps.get(stream, _now() - _LATE):
            return False
        if len(self._stamps) < _STREAMS or stream in self._stamps:
            self._stamps[stream] = stamp
        return True


def _now() -> int:
    return int((time() - _SIGNED_SINCE) * 1e5)
