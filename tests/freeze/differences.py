"""Differences between a record and the present state, each as one sentence that names its place."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

RECORDS = Path(__file__).parent / "records"
SHOWN = 12  # differences in one message


def read(part: str) -> Any:
    """Return a record."""
    return json.loads((RECORDS / f"{part}.json").read_text(encoding="utf-8"))


def write(part: str, value: Any) -> Path:
    """Write a record."""
    path = RECORDS / f"{part}.json"
    text = json.dumps(value, indent=1, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")
    return path


def differences(recorded: Any, now: Any, place: str = "") -> Iterator[str]:
    """Yield what differs, depth first, in the order of the record."""
    if isinstance(recorded, Mapping) and isinstance(now, Mapping):
        for key, value in recorded.items():
            inner = f"{place} › {key}" if place else str(key)
            if key in now:
                yield from differences(value, now[key], inner)
            else:
                yield f"{inner}: is missing; recorded {_shown(value)}"
        for key, value in now.items():
            if key not in recorded:
                yield f"{place} › {key}: is new, {_shown(value)}; record it if it is meant"
    elif isinstance(recorded, list) and isinstance(now, list) and len(recorded) == len(now):
        for i, (one, other) in enumerate(zip(recorded, now, strict=True)):
            yield from differences(one, other, f"{place}[{i}]")
    elif recorded != now or type(recorded) is not type(now):
        yield f"{place}: recorded {_shown(recorded)}, now {_shown(now)}"


def check(recorded: Any, now: Any, what: str) -> None:
    """Fail with all differences, the first ones in words."""
    now = json.loads(json.dumps(now))  # as it would be recorded
    found = list(differences(recorded, now, what))
    more = f"\n… and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
    assert not found, (
        f"{len(found)} difference(s) from the record; "
        "if they are meant, `python -m tests.freeze.record` and explain them in the commit\n"
        + "\n".join(found[:SHOWN])
        + more
    )


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 240 else f"{text[:240]}…"
