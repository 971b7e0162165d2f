"""The names that clients use, "hull.eta" or "hull.eta[3]", stand for variables of the master."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, final

import numpy as np

from uuvsim_cosim.bridge.desk import SignalInfo
from uuvsim_cosim.bridge.stepped import Stepped
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Variable

__all__ = ["Names", "Place", "nearest"]


@dataclass(frozen=True)
class Place:
    """A variable of a component, or one element of it (from 0, in flat order)."""

    path: str
    variable: Variable
    element: int | None = None


@final
class Names:
    """All variables of a master by name."""

    def __init__(self, master: Stepped) -> None:
        self._master = master
        plan = master.plan
        self.places = {
            f"{c.path}.{v.name}": Place(c.path, v)
            for c in plan.components
            for v in c.description.variables.values()
            if v.type != "Clock" and v.causality != "independent"
        }
        fed: dict[tuple[str, str], set[int]] = {}
        for t in plan.transfers:
            key = (plan.components[t.target].path, t.target_variable.name)
            fed.setdefault(key, set()).update(t.target_elements)
        self._fed = {key: len(elements) for key, elements in fed.items()}

    def schema(self) -> list[SignalInfo]:
        """List all variables."""
        return [
            SignalInfo(
                name, p.variable.type, p.variable.shape, _unit(p.variable), p.variable.causality,
                self._settable(p), p.variable.description,
            )
            for name, p in self.places.items()
        ]  # fmt: skip

    def find(self, name: str) -> Place:
        """Find a name; raises InputInvalid with names that come near."""
        place = self.places.get(name)
        if place is not None:
            return place
        match = re.fullmatch(r"(.+)\[(\d+)\]", name) if isinstance(name, str) else None
        if match is not None and (whole := self.places.get(match[1])) is not None:
            i, size = int(match[2]), whole.variable.size
            if whole.variable.shape and 1 <= i <= size:
                return Place(whole.path, whole.variable, i - 1)
            there = f"{match[1]}[1] … [{size}]" if whole.variable.shape else f"{match[1]}, a scalar"
            raise InputInvalid(f"no signal {name!r}; expected {there}")
        raise InputInvalid(f"no signal {name!r}; expected {nearest(str(name), self.places)}")

    def get(self, names: Iterable[str]) -> dict[str, Any]:
        """Read values at the present communication point."""
        found = [(name, self.find(name)) for name in names]
        return {name: self.read(place) for name, place in found}

    def read(self, place: Place) -> Any:
        """Read one value."""
        value = self._master.get(place.path, place.variable.name)
        if place.element is None:
            return np.array(value) if isinstance(value, np.ndarray) else value
        return np.ravel(value)[place.element].item()

    def fit(self, values: Mapping[str, Any]) -> list[tuple[Place, Any]]:
        """Give values as `set` takes them; raises InputInvalid if one of them does not fit."""
        fitted = []
        for name, value in values.items():
            place = self.find(name)
            if place.element is not None:
                whole = f"{place.path}.{place.variable.name}"
                raise InputInvalid(
                    f"{name}: one element; expected all {place.variable.size} of {whole} at once"
                )
            fitted.append((place, self._master.fitted(place.path, place.variable.name, value)))
        return fitted

    def set(self, fitted: Sequence[tuple[Place, Any]]) -> None:
        """Set what `fit` gave."""
        for place, value in fitted:
            self._master.set(place.path, place.variable.name, value)

    def starts(self, values: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
        """Give start values as `Master.reset` takes them."""
        from uuvsim_cosim.orchestrator.values import Misfit, as_array, fit

        starts: dict[str, dict[str, Any]] = {}
        for name, value in values.items():
            place = self.find(name)
            v = place.variable
            if place.element is not None or v.causality not in ("input", "parameter"):
                read = "one element" if place.element is not None else f"an {v.causality}"
                raise InputInvalid(f"{name}: {read}; expected a whole input or parameter")
            try:
                starts.setdefault(place.path, {})[v.name] = as_array(v, fit(v, value))
            except Misfit as misfit:
                raise InputInvalid(str(misfit.at(name))) from None
        return starts

    def _settable(self, place: Place) -> bool:
        v = place.variable
        if v.causality == "input":
            return self._fed.get((place.path, v.name), 0) < v.size
        return v.causality == "parameter" and v.variability == "tunable"


def nearest(name: str, names: Iterable[str]) -> str:
    """Say which names would have been right: those close by, else the first few."""
    known = list(names)
    close = get_close_matches(name, known, 4, 0.5)
    if close:
        return f"one such as {', '.join(close)}"
    if not known:
        return "none, for there is none"
    few = ", ".join(known[:6])
    return f"one of {few}{', …' if len(known) > 6 else ''}"


def _unit(variable: Variable) -> str:
    if variable.element_units:
        return ", ".join(u or "1" for u in variable.element_units)
    return variable.unit or "1"
