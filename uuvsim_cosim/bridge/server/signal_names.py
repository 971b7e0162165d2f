"""Names of signals, "hull.eta" or "hull.eta[3]", as clients use them for the master's variables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from uuvsim_cosim.bridge.calls.service import Schema, SignalInfo
from uuvsim_cosim.bridge.server.playback import Stepped
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.models.declaration.element_names import split_element_name
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["Fitted", "Names", "Place"]


@dataclass(frozen=True)
class Place:
    """A variable of a component, or one element of it (from 0, in flat order)."""

    path: str
    variable: Variable
    element: int | None = None


Fitted = tuple[Place, Any]  # a variable, and a value that the master has accepted for it


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
        fed: dict[tuple[str, str], set[int]] = {}  # connected elements of each input
        for t in plan.transfers:
            key = (plan.components[t.target].path, t.target_variable.name)
            fed.setdefault(key, set()).update(t.target_elements)
        self._fed = {key: len(elements) for key, elements in fed.items()}
        self.schema = Schema(
            SignalInfo(
                name, p.variable.type, p.variable.shape, _unit(p.variable), p.variable.causality,
                self._settable(p), p.variable.description,
            )
            for name, p in self.places.items()
        )  # fmt: skip

    def find(self, name: str) -> Place:
        """Find a name; raises InputInvalid with similar names."""
        place = self.places.get(name)
        if place is not None:
            return place
        stem, indices = split_element_name(name) if isinstance(name, str) else ("", ())
        if len(indices) == 1 and (whole := self.places.get(stem)) is not None:
            size = whole.variable.size
            if whole.variable.shape and 1 <= indices[0] <= size:
                return Place(whole.path, whole.variable, indices[0] - 1)
            there = f"{stem}[1] … [{size}]" if whole.variable.shape else f"{stem}, a scalar"
            raise InputInvalid(f"no signal {name!r}", there)
        raise InputInvalid(f"no signal {name!r}", expected_names(name, self.places))

    def get(self, names: Iterable[str]) -> dict[str, Any]:
        """Read values at the current communication point."""
        found = [(name, self.find(name)) for name in names]
        return {name: self.read(place) for name, place in found}

    def read(self, place: Place) -> Any:
        """Read one value."""
        value = self._master.get(place.path, place.variable.name)
        if place.element is None:
            return np.array(value) if isinstance(value, np.ndarray) else value
        return np.ravel(value)[place.element].item()

    def fit(self, values: Mapping[str, object]) -> list[Fitted]:
        """Convert values for `set`; raises InputInvalid if one of them does not fit."""
        fitted = []
        for name, value in values.items():
            place = self.find(name)
            if place.element is not None:
                whole = f"{place.path}.{place.variable.name}"
                raise InputInvalid(
                    name, "one element", f"all {place.variable.size} of {whole} at once"
                )
            fitted.append((place, self._master.fitted(place.path, place.variable.name, value)))
        return fitted

    def set(self, fitted: Sequence[Fitted]) -> None:
        """Set the values that `fit` has returned."""
        for place, value in fitted:
            self._master.set(place.path, place.variable.name, value)

    def starts(self, values: Mapping[str, object]) -> dict[str, dict[str, object]]:
        """Convert start values for `Master.reset`; raises InputInvalid if one does not fit."""
        from uuvsim_cosim.orchestrator.values.values import Misfit, as_array, fit

        starts: dict[str, dict[str, object]] = {}
        for name, value in values.items():
            place = self.find(name)
            v = place.variable
            if place.element is not None or v.causality not in ("input", "parameter"):
                read = "one element" if place.element is not None else f"an {v.causality}"
                raise InputInvalid(name, read, "a whole input or parameter")
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


def _unit(variable: Variable) -> str:
    if variable.element_units:
        return ", ".join(u or "1" for u in variable.element_units)
    return variable.unit or "1"
