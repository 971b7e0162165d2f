"""Parameters to fit by name, and the declared components that they belong to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.model import Declared, Kind, Model
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.intrinsics.table import TABLES, interpolants
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.sources import ModelSource

__all__ = ["HULL_STATES", "Fitted", "Part", "wanted_parameters"]

HULL_STATES = ("p", "q_nb", "nu_b")


@dataclass(frozen=True)
class Fitted:
    """One number to fit: its name, places, start value, unit and bounds.

    One without places is no parameter of the system (a nuisance parameter), and `size` is the
    size that it may have.
    """

    name: str
    places: tuple[tuple[int, str], ...]  # component, parameter or input: all get this number
    start: float
    unit: str
    low: float
    high: float
    size: float = 0.0

    @property
    def scale(self) -> float:
        """Return the size by which the fit divides it."""
        return self.size or (abs(self.start) if abs(self.start) > 1e-9 else 1.0)


class Part:
    """A component of the plan that is a declaration, with the system's own values."""

    def __init__(self, plan: Plan, index: int) -> None:
        planned = plan.components[index]
        source = resolve(planned.source)
        if not isinstance(source, ModelSource):
            raise InputInvalid(
                f"{planned.path} is {planned.description.kind} ({planned.source}), "
                "whose equations are not known",
                "a declaration (model:…) for each identified component",
            )
        self.index, self.path = index, planned.path
        self.source = source.text
        with interpolants():
            self.model: Model = source.declaration()
        self.f = Evaluation(self.model)
        start = {k: np.asarray(v, dtype=float).ravel() for k, v in planned.start.items()}
        known = {v.name for v in self.model.of_kind("parameter")}
        self.p = self.f.values_of("parameter", {k: v for k, v in start.items() if k in known})
        self.inputs = {
            v.name: np.asarray(start.get(v.name, v.start), dtype=float).ravel()
            for v in self.model.of_kind("input")
        }

    @property
    def calls(self) -> list[str]:
        """The names of functions that its equations call, tables aside."""
        found = []
        for f in (self.f.rhs, self.f.outputs):
            places = [k for k in range(f.n_instructions()) if f.instruction_id(k) == ca.OP_CALL]
            nodes: Any = f.instructions_sx() if places else []
            found += [nodes[k].which_function().name() for k in places]
        return sorted(set(found) - TABLES.keys())

    @property
    def usual(self) -> list[str]:
        """The names of scalars that can be saved: parameters, and the voltage."""
        every = self.model.of_kind("parameter", "input")
        return [v.name for v in every
                if v.size == 1 and (v.kind == "parameter" or v.name == "voltage")]  # fmt: skip

    def start_of(self, name: str) -> float:
        """Return the system's value of a parameter, or of an input, that is one number."""
        return float(self.inputs[name][0] if name in self.inputs else self.p[self.place(name)])

    def place(self, name: str, kind: Kind = "parameter") -> int:
        """Return where a variable begins in the vector of all of its kind."""
        at = 0
        for v in self.model.of_kind(kind):
            if v.name == name:
                return at
            at += v.size
        raise KeyError(name)


def wanted_parameters(plan: Plan, hull: int, texts: Sequence[str]) -> list[Fitted]:
    """Find the parameters that texts name: ``D_q_11`` (the hull's), ``hull.m``, ``thruster_*.K_n``.

    A pattern with a * is one number that all matching places share. Raises InputInvalid with all
    unknown names and similar ones.
    """
    names: dict[str, tuple[int, str]] = {}
    parts: dict[int, Part] = {}
    sizes: dict[str, int] = {}
    fed = {(t.target, t.target_variable.name) for t in plan.transfers}
    for i, c in enumerate(plan.components):
        # Inputs that nothing feeds and that could be constant, as the voltage of a supply.
        held = (v for v in c.description.of("input") if (i, v.name) not in fed
                and v.name not in ("u", "tau", "thrust", "force") and v.shape == ())  # fmt: skip
        for v in (*c.description.of("parameter"), *held):
            names[f"{c.path}.{v.name}"] = (i, v.name)
            sizes[f"{c.path}.{v.name}"] = int(np.prod(v.shape, dtype=int))
    wrong, found = [], []
    named: set[str] = set()
    for text in dict.fromkeys(t.strip() for t in texts if t.strip()):
        full = text if "." in text else f"{plan.components[hull].path}.{text}"
        hits = [n for n in names if n == full or ("*" in full and fnmatchcase(n, full))]
        if not hits:
            wrong.append(f"there is no parameter {text!r}; expected {expected_names(full, names)}")
            continue
        wide = [n for n in hits if sizes[n] != 1]
        if wide or named & set(hits):
            wrong.append(
                f"{wide[0]} has {sizes[wide[0]]} elements; expected a parameter that is one number"
                if wide
                else f"{text}: {', '.join(sorted(named & set(hits)))} is named twice; expected once"
            )
            continue
        named |= set(hits)
        for n in hits:
            parts.setdefault(names[n][0], Part(plan, names[n][0]))
        places = tuple(names[n] for n in hits)
        declared = parts[places[0][0]].model.variables[places[0][1]]
        start = float(np.mean([parts[i].start_of(n) for i, n in places]))
        found.append(Fitted(full, places, start, declared.unit, *_bounds(declared, start)))
    if not found and not wrong:
        wrong = ["no parameters; expected names such as D_q_11,M_A_11,thruster_*.K_n"]
    if wrong:
        raise InputInvalid("--parameters: " + "; ".join(wrong))
    return found


def _bounds(declared: Declared, start: float) -> tuple[float, float]:
    """Return the declared bounds; if a value cannot be negative, 1/50 to 30 times the start.

    Without bounds, parameters that the data do not determine could grow until no step is short
    enough.
    """
    low = -np.inf if declared.min is None else float(declared.min)
    high = np.inf if declared.max is None else float(declared.max)
    kind, _, indices = declared.name.rpartition("_")
    brakes = kind in ("M_A", "D_l", "D_q", "D_u", "I_g", "I_b") and len(set(indices)) == 1
    if brakes:
        low = max(low, 0.0)
    if start > 0 and (brakes or low >= 0.0):
        return max(low, 0.02 * start), min(high, 30.0 * start)
    return low, high
