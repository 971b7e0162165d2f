"""One comparison with published numbers: quantity, source, deviation and verdict."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import did_you_mean

__all__ = ["GROUPS", "Checked", "compared", "known_groups", "number", "reference_values"]

# Whose numbers these are: the word after `uuvsim models check --source`.
GROUPS: dict[str, str] = {
    "blue_robotics": "bench rows of the T200 (public performance data, 2019)",
    "closed_form": "closed forms of the equations, by the vehicle's own numbers",
    "diff_uv": "diff_uv's equations, integrated by DOP853",
    "fossen": "Fossen's Python vehicle simulator, remus100.py",
    "gz_sim": "gz-sim's own tests",
    "healey_lienard": "Healey and Lienard (1993), NPS AUV",
    "lauv_gazebo": "lauv_gazebo @3529e028, LAUV",
    "lrauv": "system tests of the Tethys-class LRAUV",
    "mss": "Fossen's Marine Systems Simulator, evaluated by GNU Octave",
    "prestero": "Prestero (2001), REMUS",
    "published": "checks that a vehicle's own folder lists",
    "typed_again": "the equations typed again from the numbers alone, integrated by DOP853",
    "uuv_simulator": "uuv_simulator's Python and its own tests",
}
_OTHER_WORDS = {
    "python_vehicle_simulator": "fossen",
    "pvs": "fossen",
    "gazebo": "gz_sim",
    "gz": "gz_sim",
    "t200": "blue_robotics",
    "npsauv": "healey_lienard",
    "remus": "prestero",
    "tethys": "lrauv",
    "octave": "mss",
}


@dataclass(frozen=True)
class Checked:
    """One comparison; `known` is the cause of a difference that is known, else empty.

    `address` is a vehicle's set (``id@set``), a component, or empty for a function; `off` and
    `tolerance` are in the unit of what is compared, or relative where `what` says so.
    """

    address: str
    what: str
    off: float
    tolerance: float
    source: str
    known: str = ""
    group: str = "published"

    @property
    def holds(self) -> bool:
        """Return whether it is within its tolerance."""
        return self.off <= self.tolerance

    @property
    def verdict(self) -> str:
        """Return `holds`, `known` (beyond its tolerance, and why is known) or `FAILS`."""
        return "holds" if self.holds else "known" if self.known else "FAILS"


def compared(
    group: str,
    address: str,
    what: str,
    ours: ArrayLike,
    theirs: ArrayLike,
    tolerance: float,
    *,
    relative: bool = False,
    known: str = "",
    source: str = "",
) -> Checked:
    """Compare two arrays: the greatest difference of an element, or of it to the greatest one."""
    one, other = np.asarray(ours, dtype=float), np.asarray(theirs, dtype=float)
    off = float(np.max(np.abs(one - other)))
    if relative:
        off /= max(float(np.max(np.abs(other))), 1e-300)
    off = off if np.isfinite(off) else float("inf")
    text = f"{what} (relative)" if relative else what
    return Checked(address, text, off, tolerance, source or GROUPS[group], known, group)


def number(expression: Any) -> Any:
    """Return the value of a CasADi expression without symbols, as an array."""
    return np.array(ca.evalf(ca.densify(ca.SX(expression))))


@lru_cache
def reference_values(name: str) -> Any:
    """Read a file of models/reference."""
    from ruamel.yaml import YAML

    return YAML(typ="safe").load(content("models", "reference", name).read_text(encoding="utf-8"))


def known_groups(words: Iterable[str]) -> set[str]:
    """Return the groups of what a user calls them; raises InputInvalid with near names."""
    groups = set()
    for word in words:
        plain = word.strip().lower().replace("-", "_").replace(" ", "_")
        group = _OTHER_WORDS.get(plain, plain)
        if group not in GROUPS:
            hint = did_you_mean(plain, [*GROUPS, *_OTHER_WORDS])
            raise InputInvalid(f"source {word!r}{hint}", f"one of {', '.join(GROUPS)}")
        groups.add(group)
    return groups
