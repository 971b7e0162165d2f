"""Grants: what an isolated FMU may do beyond its sandbox."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

from uuvsim_cosim.errors import InputInvalid

__all__ = ["GRANTS", "Grants", "size_text"]

GRANTS = "read:PATH, files:PATH, tcp:PORT, network, processes, memory:8GiB or all"
_MEMORY = 4 << 30  # [bytes] by default
_UNITS = {"k": 10, "M": 20, "G": 30, "T": 40}  # exponents of 2, with "iB"


@final
@dataclass(frozen=True)
class Grants:
    """Accesses of one FMU; without any, it reads its own files and those of the system only."""

    read: tuple[str, ...] = ()  # absolute paths of files and folders
    files: tuple[str, ...] = ()  # the same, also to be written
    ports: tuple[int, ...] = ()  # of TCP
    network: bool = False
    processes: bool = False
    memory: int = _MEMORY  # [bytes] of addresses, in addition to those before it is loaded
    all: bool = False  # no sandbox

    @classmethod
    def of(cls, texts: Iterable[str], option: str = "grants") -> Grants:
        """Read grants; raises InputInvalid.

        Example:

        >>> from uuvsim_cosim.fmus.isolation.grants import Grants
        >>> Grants.of(["read:/data", "tcp:5000"]).ports
        (5000,)
        """
        found = cls()
        for text in texts:
            word, _, value = text.partition(":")
            if text == "network":
                found = replace(found, network=True)
            elif text == "processes":
                found = replace(found, processes=True)
            elif text == "all":
                found = replace(found, all=True)
            elif word in ("read", "files") and value:
                path = Path(value).expanduser().resolve()
                if not path.exists():
                    raise InputInvalid(
                        f"{option} {text}", f"there is no {path}", "a file or folder"
                    )
                if word == "read":
                    found = replace(found, read=(*found.read, str(path)))
                else:
                    found = replace(found, files=(*found.files, str(path)))
            elif word == "tcp" and value.isdecimal() and 0 < int(value) < 1 << 16:
                found = replace(found, ports=(*found.ports, int(value)))
            elif word == "memory" and (size := _bytes(value)):
                found = replace(found, memory=size)
            elif word == "memory":
                number = value if value.isdecimal() else "64"
                expected = f"a size with a unit, memory:{number}MiB or memory:{number}GiB"
                raise InputInvalid(option, f"{text!r} was read", expected)
            else:
                raise InputInvalid(option, f"{text!r} was read", GRANTS)
        return found


def size_text(size: int, digits: int = 2) -> str:
    """Return a number of bytes for a message, rounded up to decimal `digits`: ``3.26 GiB``."""
    for name in ("G", "M", "k"):
        if size >= 1 << _UNITS[name]:
            rounded = -(-size * 10**digits >> _UNITS[name]) / 10**digits
            text = f"{rounded:.{digits}f}"
            return f"{text.rstrip('0').rstrip('.') if digits else text} {name}iB"
    return f"{size} bytes"


def _bytes(text: str) -> int:
    found = re.fullmatch(r"(\d{1,9}(?:\.\d+)?) ?(?:([kMGT])iB)", text)
    return 0 if found is None else int(float(found[1]) * (1 << _UNITS[found[2]]))
