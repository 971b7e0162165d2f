"""Content of an access file: the users, certificates and addresses of a served co-simulation."""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from uuvsim_cosim.bridge.access.passwords import is_hash
from uuvsim_cosim.bridge.access.roles import ROLES, permissions
from uuvsim_cosim.bridge.access.tls import Tls, certificate_problem
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.yaml_text import YamlText, shown

__all__ = ["LOOPBACK", "Access", "User", "is_loopback", "read_access"]

_KEYS = ("users", "anyone", "listen", "tls")
_TLS = ("certificate", "key", "ca", "roles")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._@-]{0,63}")
_NONE = "none"


def read_access(path: str | Path) -> Access:
    """Read an access file; raises InputInvalid with all of its mistakes."""
    file = Path(path)
    text = YamlText(file, "an access file")
    if not text.keys([], text.data, _KEYS):
        text.refuse()
    data = text.data
    users = _users(text, data["users"]) if "users" in data else {}
    anyone = None
    if (role := data.get("anyone", _NONE)) != _NONE:
        anyone = _role(text, ["anyone"], role, (_NONE,))
    plain = data.get("tls") == _NONE
    tls = None if plain or "tls" not in data else _tls(text, data["tls"], file.parent)
    listen = _listen(text, data["listen"]) if "listen" in data else LOOPBACK
    if not text.mistakes and not users and anyone is None and not (tls and tls.roles):
        text.wrong([], "no client is admitted; expected users, anyone, or roles of certificates")
    far = [host for host in listen if not is_loopback(host)]
    if not text.mistakes and far and tls is None and not plain:
        text.wrong(
            ["listen"],
            f"{', '.join(far)} without tls: others in the network can read passwords and values; "
            "expected tls with a certificate and a key, or `tls: none` to allow this",
        )
    text.refuse()
    return Access(users, tls, anyone, listen, plain)


def _users(text: YamlText, data: object) -> dict[str, User]:
    found: dict[str, User] = {}
    if not isinstance(data, Mapping):
        text.wrong(["users"], "expected a mapping, such as ann: {role: owner, password: …}")
        return found
    for name, entry in data.items():
        place = ["users", name]
        if not _NAME.fullmatch(str(name)):
            text.wrong(place, "a name has letters, digits and . _ @ -, at most 64")
        elif text.keys(place, entry, ("role", "password"), needed=("role", "password")):
            role = _role(text, [*place, "role"], entry.get("role"))
            if not is_hash(entry.get("password")):  # not shown: it may be the password itself
                text.wrong(
                    [*place, "password"],
                    "not a salted hash; expected the output of `uuvsim access password`",
                )
            elif role is not None:
                found[str(name)] = User(str(name), role, str(entry["password"]))
    return found


def _listen(text: YamlText, data: object) -> tuple[str, ...]:
    hosts = [data] if isinstance(data, str) else data
    if not isinstance(hosts, list) or not hosts or not all(isinstance(h, str) for h in hosts):
        text.wrong(["listen"], f"{_shown(data)}; expected addresses, such as [127.0.0.1, 0.0.0.0]")
        return LOOPBACK
    for k, host in enumerate(hosts):
        try:
            ipaddress.ip_address(str(host))
        except ValueError:
            text.wrong(
                ["listen", k],
                f"{host!s} is no address of this machine; expected one such as 127.0.0.1, or "
                "0.0.0.0 "
                "for all (ports are options of `uuvsim serve`)",
            )
    return tuple(dict.fromkeys(str(host) for host in hosts))


def _tls(text: YamlText, data: object, folder: Path) -> Tls | None:
    allowed = text.keys(["tls"], data, _TLS, needed=("certificate", "key"))
    if not allowed or not isinstance(data, Mapping):  # `keys` has noted what is wrong
        return None
    files: dict[str, Path] = {}
    for key in ("certificate", "key", "ca"):
        if key not in data:
            continue
        file = folder / str(data[key])
        if not file.is_file():
            text.wrong(["tls", key], f"{data[key]!s}: no such file; expected PEM in {folder}")
        files[key] = file
    roles: dict[str, str] = {}
    given = data.get("roles", {})
    if not isinstance(given, Mapping):
        text.wrong(["tls", "roles"], f"{_shown(given)}; expected common name: role")
        given = {}
    for name, role in given.items():
        if not _NAME.fullmatch(str(name)):
            text.wrong(["tls", "roles", name], "a name has letters, digits and . _ @ -, at most 64")
        elif (known := _role(text, ["tls", "roles", name], role)) is not None:
            roles[str(name)] = known
    if roles and "ca" not in data:
        text.wrong(["tls", "roles"], "roles of certificates; expected the `ca` that signs them")
    if text.mistakes:
        return None
    tls = Tls(files["certificate"], files["key"], files.get("ca"), roles)
    if (problem := certificate_problem(tls)) is not None:
        text.wrong(["tls"], problem)
    return tls


def _role(
    text: YamlText, place: list[str | int], role: object, others: Iterable[str] = ()
) -> str | None:
    """Return a role that exists, else note the mistake; a missing role has been noted already."""
    if role is None:
        return None
    if not isinstance(role, str) or role not in ROLES:
        known = [*ROLES, *others]
        text.wrong(place, f"role {_shown(role)}; expected {expected_names(role, known)}")
        return None
    return str(role)


def _shown(data: object) -> str:
    """Describe a value for a message, never its content, which may be a password."""
    if isinstance(data, Mapping | list):
        return f"a {'mapping' if isinstance(data, Mapping) else 'list'}"
    return shown(data)


LOOPBACK = ("127.0.0.1", "::1")


@dataclass(frozen=True)
class User:
    """A user with a password, which is stored as a salted scrypt hash."""

    name: str
    role: str
    password: str  # scrypt$n$r$p$salt$hash


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
