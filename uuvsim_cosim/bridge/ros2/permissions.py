"""Permissions of ROS 2 machines by the certificates that they show (mutual TLS).

A message of ROS 2 has no sender that could be verified. Zenoh knows the certificate of a
connection, and refuses what the role of its common name does not permit. All nodes behind one
router of ROS have the role of that router's certificate.
"""

from __future__ import annotations

from uuvsim_cosim.bridge.access.access_file import Access
from uuvsim_cosim.bridge.access.roles import permissions
from uuvsim_cosim.bridge.access.zenoh_permissions import listening_tls, rule
from uuvsim_cosim.bridge.ros2.services import NEEDED
from uuvsim_cosim.errors import InputInvalid

__all__ = ["guarded_node", "is_mutual"]

_LIVELINESS = ["liveliness_token", "declare_liveliness_subscriber", "liveliness_query"]


def is_mutual(access: Access | None) -> bool:
    """Return whether an access file requires certificates of clients."""
    return access is not None and access.tls is not None and access.tls.ca is not None


def guarded_node(access: Access, domain: int, node: str) -> dict[str, object]:
    """Return the settings of a node's session that listens with mutual TLS.

    `read` permits to receive topics, and to be seen; `set` to publish in the domain; services need
    the permission of their call. Raises InputInvalid for an access file without an authority.
    """
    if access.tls is None or not is_mutual(access):
        raise InputInvalid("the access file", "has no tls with ca", "the CA of the certificates")
    topics, caches = [f"{domain}/**"], [f"{domain}/**/@adv/**"]
    rules = {
        "read": [
            rule("subscribe", "ingress", ["declare_subscriber"], topics + caches),
            rule("publish", "egress", ["put", "declare_queryable", "reply"], topics + caches),
            rule("ask-caches", "ingress", ["query"], caches),
            rule("be-seen", "ingress", _LIVELINESS, ["@ros2_lv/**", *caches]),
            rule("see", "egress", _LIVELINESS, ["@ros2_lv/**", *caches]),
        ],
        "set": [
            rule("command", "ingress", ["put"], topics),
            rule("listen", "egress", ["declare_subscriber"], topics),
        ],
        "step": [],
    }
    for name, needed in NEEDED.items():
        rules[needed].append(rule(name, "ingress", ["query"], [f"{domain}/{node}/{name}/*/*"]))

    def permitted(allowed: frozenset[str]) -> list[object]:
        return [one["id"] for needed, some in rules.items() if needed in allowed for one in some]

    subjects: list[dict[str, object]] = [{"id": "anyone"}]
    policies: list[dict[str, object]] = [
        {"rules": permitted(access.anonymous), "subjects": ["anyone"]}
    ]
    for k, (name, role) in enumerate(access.tls.roles.items()):
        subjects.append({"id": f"is-{k}", "cert_common_names": [name]})
        policies.append({"rules": permitted(permissions(role)), "subjects": [f"is-{k}"]})
    return {
        **listening_tls(access.tls),
        "access_control": {
            "enabled": True,
            "default_permission": "deny",
            "rules": [one for some in rules.values() for one in some],
            "subjects": subjects,
            "policies": [policy for policy in policies if policy["rules"]],
        },
    }
