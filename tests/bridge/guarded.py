"""An access file and certificates for tests: who is who, made once."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from uuvsim_cosim.bridge.access.passwords import hashed

PASSWORDS = {"ann": "rudder amidships", "bob": "periscope", "cy": "ballast", "dee": "sonar ping"}
ROLES = {"ann": "owner", "bob": "observer", "cy": "controller", "dee": "operator"}


@cache
def _hash(name: str) -> str:
    return hashed(PASSWORDS[name])


def access_file(folder: Path, *lines: str, users: tuple[str, ...] = tuple(ROLES)) -> Path:
    """Write an access file with the users, and lines beside them."""
    said = [f"  {name}: {{role: {ROLES[name]}, password: {_hash(name)}}}" for name in users]
    file = folder / "access.yaml"
    file.write_text("\n".join([*(["users:"] if users else []), *said, *lines]) + "\n")
    return file
