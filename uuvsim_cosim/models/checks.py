"""Every check of a vehicle: reference trajectories, published values, closed forms, in one list.

`reference/<set>_*.csv` are trajectories (check.py), `checks.yaml` holds single published values
and the closed forms that a published set is known to break, with the cause.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.check import check
from uuvsim_cosim.models.closed_forms import closed_forms
from uuvsim_cosim.models.folder import read_folder
from uuvsim_cosim.models.library import declare
from uuvsim_cosim.models.parameters import (
    line_of,
    read_yaml,
    split_address,
    vehicle_folder,
    vehicle_sets,
)
from uuvsim_cosim.models.simulate import simulate

__all__ = ["Checked", "checks_of"]

TRAJECTORY_TOLERANCE = 1e-5


@dataclass(frozen=True)
class Checked:
    """One comparison; `known` is the cause of a difference that is known, else empty."""

    address: str
    what: str
    off: float
    tolerance: float
    source: str
    known: str = ""

    @property
    def holds(self) -> bool:
        """Say whether it is within its tolerance."""
        return self.off <= self.tolerance


def checks_of(address: str, h: float = 1e-2) -> Iterator[Checked]:
    """Run every check of a vehicle, or of one of its sets (``id@set``).

    First every file of its folder is read: raises ParameterInvalid with all mistakes of all.
    """
    id, chosen = split_address(address)
    read_folder(id)
    sets = vehicle_sets(id)
    if chosen is not None and chosen not in sets:
        raise InputInvalid(
            f"{id}: there is no parameter set {chosen!r}; expected {', '.join(sets)}"
        )
    folder = vehicle_folder(id)
    data = _read(folder, sets)
    wanted = sets if chosen is None else [chosen]
    for file in sorted((folder / "reference").glob("*.csv")):
        owners = [s for s in sets if file.stem == s or file.stem.startswith(f"{s}_")]
        if not owners:
            raise InputInvalid(f"{file}: expected a name that begins with {', '.join(sets)}")
        owner = max(owners, key=len)
        if owner in wanted:
            worst = max(check(f"{id}@{owner}", file, h), key=lambda d: d.max)
            what = f"trajectory {file.stem.removeprefix(owner).strip('_')}: {worst.column}"
            yield Checked(f"{id}@{owner}", what, worst.max, TRAJECTORY_TOLERANCE, file.name)
    for entry in data.get("checks", ()):
        if entry["set"] in wanted:
            yield _published(id, entry, 2.0 * h)
    for name in wanted:
        for form in closed_forms(declare(f"{id}@{name}", surface=False)):
            known = [
                str(k["because"])
                for k in data.get("known", ())
                if k["check"] == form.name and k["set"] in (name, "*")
            ]
            cause = known[0] if known and form.off > form.tolerance else ""
            yield Checked(f"{id}@{name}", form.name, form.off, form.tolerance, "closed form", cause)


def _published(id: str, entry: Mapping[str, Any], h: float) -> Checked:
    address = f"{id}@{entry['set']}"
    until = float(entry["until"])
    inputs = {"v_c": entry["v_c"]} if "v_c" in entry else None
    result = simulate(
        declare(address, surface=False),
        at=[0.0, until] if until > 0 else [0.0],
        h=h,
        tau=entry.get("tau"),
        inputs=inputs,
        parameters=entry.get("parameters"),
    )
    off = 0.0
    for output, values in entry["expect"].items():
        if output not in ("eta", "nu", "nu_dot", "nu_r"):
            raise InputInvalid(f"{address}: expect: {output!r}; expected eta, nu, nu_dot or nu_r")
        for ours, theirs in zip(result[output][-1], values, strict=True):
            if theirs is not None:
                off = max(off, float(abs(ours - theirs)))
    return Checked(
        address, str(entry["what"]), off, float(entry["tolerance"]), str(entry["source"])
    )


def _read(folder: Path, sets: list[str]) -> Any:
    path = folder / "checks.yaml"
    if not path.is_file():
        return {}
    data = read_yaml(path, "checks.schema.json")
    for kind in ("checks", "known"):
        for i, entry in enumerate(data.get(kind, ())):
            if entry["set"] not in sets and (kind == "checks" or entry["set"] != "*"):
                line = line_of(data, [kind, i, "set"])
                raise InputInvalid(
                    f"{path}:{line}: set: {entry['set']!r}; expected {', '.join(sets)}"
                )
            for values in entry.get("expect", {}).values():
                if all(v is None for v in values):
                    line = line_of(data, [kind, i, "expect"])
                    raise InputInvalid(f"{path}:{line}: expect: nothing; expected a number")
    return data
