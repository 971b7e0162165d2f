"""``proxyfmu://localhost?file=…``, libcosim's URI of an FMU in a process, as a file."""

from __future__ import annotations

from urllib.parse import parse_qs, unquote, urlsplit

from uuvsim_cosim.errors import InputInvalid

__all__ = ["REMARK", "proxy_file"]

REMARK = "proxyfmu is read as its file; --isolate gives it a process"


def proxy_file(source: str) -> str | None:
    """Return the file that a proxyfmu URI names, None for any other source.

    Raises InputInvalid for one on another machine, or without a file.
    """
    if not source.lower().startswith("proxyfmu:"):
        return None
    parts = urlsplit(source)
    file = parse_qs(parts.query).get("file", [""])[0]
    if (parts.hostname or "localhost") not in ("localhost", "127.0.0.1") or not file:
        raise InputInvalid(
            f"source {source!r}",
            "an FMU, or proxyfmu://localhost?file=…: nothing is run on other machines",
        )
    return unquote(file.replace("file:///", "/"))
