"""Zenoh's own access control: TLS, the right to subscribe to states, and protection from forgery.

A client opens a session as user `guest` and sends calls as queries, which the bridge answers. The
password of `guest` is the server's token, so that no other client can open a session and use up a
place; if an access file names users, the password is "guest". A client that may read gets a second
user on joining, `reader`, whose sessions receive states. Zenoh lets no client declare queryables or
publish, so passwords cannot be intercepted and states cannot be forged.
"""

from __future__ import annotations

import os
import secrets
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from uuvsim_cosim.bridge.access.access_file import Access
from uuvsim_cosim.bridge.access.tls import Tls
from uuvsim_cosim.bridge.calls.zenoh_keys import (
    call_key,
    certificate_key,
    client_key,
    master_key,
    remote_component_key,
    state_key,
)

__all__ = [
    "GUEST",
    "READER",
    "client_settings",
    "endpoints",
    "guarded",
    "guarded_component",
    "listening_tls",
    "reader_password",
    "rule",
]

GUEST, READER = "guest", "reader"
_STATES = state_key(component="**")
_COMPONENT = remote_component_key()


def reader_password() -> str:
    """Return the password of `reader` for one run."""
    return secrets.token_urlsafe(24)


def endpoints(hosts: Sequence[str], port: int, *, tls: bool) -> list[str]:
    """Return the endpoints at which Zenoh listens or connects."""
    shown = (f"[{host}]" if ":" in host else host for host in hosts)
    return [f"{'tls' if tls else 'tcp'}/{host}:{port}" for host in shown]


@contextmanager
def guarded(access: Access | None, reader: str) -> Iterator[dict[str, object]]:
    """Yield the settings of a session that listens.

    The file of users exists only until the context ends; Zenoh reads it when the session opens.
    """
    if access is None:
        yield {}
        return
    settings: dict[str, object] = {"access_control": _rules(access)}
    if access.tls is not None:
        settings |= listening_tls(access.tls)
    with _users({GUEST: access.token or GUEST, READER: reader}) as users:
        yield settings | users


def listening_tls(tls: Tls) -> dict[str, object]:
    """Return the settings of a session that listens with TLS; `ca` requires certificates."""
    mutual = {} if tls.ca is None else {"root_ca_certificate": str(tls.ca)}
    return {
        "transport/link/tls": {
            "listen_certificate": str(tls.certificate),
            "listen_private_key": str(tls.key),
            "enable_mtls": bool(mutual),
            **mutual,
        }
    }


@contextmanager
def guarded_component(token: str) -> Iterator[dict[str, object]]:
    """Yield the settings of a session that serves a component to clients with the token.

    These may only send queries to the component.
    """
    rules = [
        rule("ask", "ingress", ["query"], [_COMPONENT]),
        rule("answer", "egress", ["declare_queryable", "reply"], [_COMPONENT]),
        rule("look", "ingress", ["liveliness_query"], [_COMPONENT]),
        rule("lives", "egress", ["liveliness_token"], [_COMPONENT]),
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
def _users(passwords: Mapping[str, str]) -> Iterator[dict[str, object]]:
    """Yield the setting of Zenoh's users; their file exists only until the context ends."""
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
) -> dict[str, object]:
    """Return the settings of a session that connects; `user` is `GUEST` or `READER`."""
    settings: dict[str, object] = {}
    if user is not None:
        settings["transport/auth/usrpwd"] = {
            "user": user, "password": password, "dictionary_file": None
        }  # fmt: skip
    tls: dict[str, object] = {}
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


def _rules(access: Access) -> Mapping[str, object]:
    """Return Zenoh's access control for a bridge: everything that no rule allows is denied."""
    names = [] if access.tls is None else list(access.tls.roles)
    own_keys = [certificate_key(name=name) for name in names]
    rules = [
        rule("ask", "ingress", ["query"], [call_key()]),
        rule("answer", "egress", ["declare_queryable", "reply"], [call_key(), certificate_key()]),
        rule(
            "look", "ingress", ["liveliness_query", "declare_liveliness_subscriber"], [master_key()]
        ),
        rule("lives", "egress", ["liveliness_token"], [master_key()]),
        rule("live", "ingress", ["liveliness_token"], [client_key()]),
        rule("subscribe", "ingress", ["declare_subscriber"], [_STATES]),
        rule("publish", "egress", ["put"], [_STATES]),
        *(rule(f"is-{k}", "ingress", ["query"], [key]) for k, key in enumerate(own_keys)),
    ]
    reading = [READER, *([GUEST] if "read" in access.anonymous else [])]
    subjects: list[dict[str, object]] = [
        {"id": "all", "usernames": [GUEST, READER]},
        {"id": "reading", "usernames": reading},
    ]
    for k, name in enumerate(names):
        subjects.append({"id": f"is-{k}", "cert_common_names": [name]})
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


def rule(name: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, object]:
    """Return a rule that allows messages of one direction on some keys."""
    return {
        "id": name,
        "flows": [flow],
        "messages": messages,
        "permission": "allow",
        "key_exprs": keys,
    }
