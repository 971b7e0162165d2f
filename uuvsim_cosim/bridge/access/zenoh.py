"""What Zenoh itself keeps: TLS, who may subscribe to states, and that nobody speaks for others.

A client opens a session as user `guest` and asks calls, which the bridge answers in words. The
password of `guest` is the server's token, so that nobody without it can open a session and take a
place; where an access file names users, it is "guest". One that may read is told on joining a
second user, `reader`, whose sessions receive states. Zenoh lets no client declare queryables or
publish, so passwords and states cannot be taken or forged.
"""

from __future__ import annotations

import os
import secrets
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from uuvsim_cosim.bridge.access.access_file import Access

__all__ = [
    "GUEST",
    "READER",
    "client_settings",
    "endpoints",
    "guarded",
    "guarded_component",
    "reader_password",
]

GUEST, READER = "guest", "reader"
_CALLS = "uuvsim/*/call/*"
_BY_CERTIFICATE = "uuvsim/*/certificate"
_STATES = "uuvsim/*/state/**"
_MASTER = "uuvsim/*/live/master"
_CLIENTS = "uuvsim/*/live/client/*"
_COMPONENT = "uuvsim-component/*/*"


def reader_password() -> str:
    """Return the password of `reader` for one run."""
    return secrets.token_urlsafe(24)


def endpoints(hosts: Sequence[str], port: int, *, tls: bool) -> list[str]:
    """Return where Zenoh listens or connects."""
    shown = (f"[{host}]" if ":" in host else host for host in hosts)
    return [f"{'tls' if tls else 'tcp'}/{host}:{port}" for host in shown]


@contextmanager
def guarded(access: Access | None, reader: str) -> Iterator[dict[str, Any]]:
    """Return the settings of a session that listens; the file of users exists meanwhile only."""
    if access is None:
        yield {}
        return
    settings: dict[str, Any] = {"access_control": _rules(access)}
    if access.tls is not None:
        mutual = access.tls.ca is not None
        settings["transport/link/tls"] = {
            "listen_certificate": str(access.tls.certificate),
            "listen_private_key": str(access.tls.key),
            "enable_mtls": mutual,
            **({"root_ca_certificate": str(access.tls.ca)} if mutual else {}),
        }
    with _users({GUEST: access.token or GUEST, READER: reader}) as users:
        yield settings | users


@contextmanager
def guarded_component(token: str) -> Iterator[dict[str, Any]]:
    """Return the settings of a session that serves a component to those who have the token.

    They may ask it, and no more.
    """
    rules = [
        _rule("ask", "ingress", ["query"], [_COMPONENT]),
        _rule("answer", "egress", ["declare_queryable", "reply"], [_COMPONENT]),
        _rule("look", "ingress", ["liveliness_query"], [_COMPONENT]),
        _rule("lives", "egress", ["liveliness_token"], [_COMPONENT]),
    ]
    policy = {"rules": [rule["id"] for rule in rules], "subjects": ["all"]}
    with _users({GUEST: token}) as users:
        yield {
            "access_control": {
                "enabled": True, "default_permission": "deny", "rules": rules,
                "subjects": [{"id": "all", "usernames": [GUEST]}], "policies": [policy],
            },
            **users,
        }  # fmt: skip


@contextmanager
def _users(passwords: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    """Return the setting of Zenoh's users; their file exists meanwhile only."""
    number, name = tempfile.mkstemp(prefix="uuvsim-")  # readable by this user only
    try:
        with os.fdopen(number, "w", encoding="ascii") as file:
            file.writelines(f"{user}:{password}\n" for user, password in passwords.items())
        yield {"transport/auth/usrpwd": {"user": None, "password": None, "dictionary_file": name}}
    finally:
        Path(name).unlink(missing_ok=True)


def client_settings(
    user: str | None,
    password: str | None,
    ca: str | Path | None = None,
    certificate: str | Path | None = None,
    key: str | Path | None = None,
) -> dict[str, Any]:
    """Return the settings of a session that connects; `user` is one of Zenoh's two."""
    settings: dict[str, Any] = {}
    if user is not None:
        settings["transport/auth/usrpwd"] = {
            "user": user, "password": password, "dictionary_file": None
        }  # fmt: skip
    tls: dict[str, Any] = {}
    if ca is not None:
        tls["root_ca_certificate"] = str(ca)
    if certificate is not None:
        tls |= {
            "connect_certificate": str(certificate), "connect_private_key": str(key),
            "enable_mtls": True,
        }  # fmt: skip
    if tls:
        settings["transport/link/tls"] = tls | {"verify_name_on_connect": True}
    return settings


def _rules(access: Access) -> Mapping[str, Any]:
    names = [] if access.tls is None else list(access.tls.roles)
    mine = [f"{_BY_CERTIFICATE}/{name}" for name in names]
    rules = [
        _rule("ask", "ingress", ["query"], [_CALLS]),
        _rule("answer", "egress", ["declare_queryable", "reply"], [_CALLS, f"{_BY_CERTIFICATE}/*"]),
        _rule("look", "ingress", ["liveliness_query", "declare_liveliness_subscriber"], [_MASTER]),
        _rule("lives", "egress", ["liveliness_token"], [_MASTER]),
        _rule("live", "ingress", ["liveliness_token"], [_CLIENTS]),
        _rule("subscribe", "ingress", ["declare_subscriber"], [_STATES]),
        _rule("publish", "egress", ["put"], [_STATES]),
        *(_rule(f"is-{k}", "ingress", ["query"], [key]) for k, key in enumerate(mine)),
    ]
    reading = [READER, *([GUEST] if "read" in access.anonymous else [])]
    subjects: list[dict[str, Any]] = [
        {"id": "all", "usernames": [GUEST, READER]},
        {"id": "reading", "usernames": reading},
        *({"id": f"is-{k}", "cert_common_names": [name]} for k, name in enumerate(names)),
    ]
    policies = [
        {"rules": ["ask", "answer", "look", "lives", "live"], "subjects": ["all"]},
        {"rules": ["subscribe", "publish"], "subjects": ["reading"]},
        *({"rules": [f"is-{k}"], "subjects": [f"is-{k}"]} for k in range(len(names))),
    ]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(name: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {
        "id": name,
        "flows": [flow],
        "messages": messages,
        "permission": "allow",
        "key_exprs": keys,
    }
