"""Options NAME=VALUE whose names may be dotted and whose values are as in YAML: nested mappings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from uuvsim_cosim.commands.shared.name_value_options import assignments, value_of
from uuvsim_cosim.errors import InputInvalid

__all__ = ["nested"]


def nested(option: str, texts: Iterable[str], expected: str) -> dict[str, Any]:
    """Return {"rules": {"credit": "own"}} of ``rules.credit=own``; raises InputInvalid."""
    found: dict[str, Any] = {}
    for name, text in assignments(option, texts, expected, dotted=False).items():
        *parents, last = name.split(".")
        place = found
        for parent in parents:
            place = place.setdefault(parent, {})
            if not isinstance(place, dict):
                raise InputInvalid(f"{option} {name}", f"{parent} has a value already", "one")
        place[last] = value_of(text)
        if isinstance(place[last], str):  # no number; YAML may read a truth value, list or mapping
            from ruamel.yaml import YAML
            from ruamel.yaml.error import YAMLError

            try:
                place[last] = YAML(typ="safe", pure=True).load(text)
            except YAMLError:
                raise InputInvalid(
                    f"{option} {name}={text}", "cannot be read", "a value as in YAML"
                ) from None
    return found
