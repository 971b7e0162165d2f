"""Check that actuators carry the net weights that are drawn: at the ends of the distributions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.randomisation.targets import Places, Quantity
from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.orchestrator.plan.net_weight import (
    WEIGHT,
    net_weight,
    net_weight_findings,
    with_values,
)
from uuvsim_cosim.orchestrator.plan.vehicle_match import or_forced

__all__ = ["net_weight_at_ends", "net_weight_of_runs"]

Array = NDArray[np.float64]
TOGETHER = 0.5  # correlation from which two draws have their ends at once


def net_weight_at_ends(
    places: Places, quantities: Iterable[Quantity], correlation: Mapping[tuple[str, str], float]
) -> tuple[str, ...]:
    """Return warnings of hulls that the ends of the drawn weights make too heavy or too light.

    Mass at its upper and volume at its lower end are the heaviest hull. Draws of a correlation of
    `TOGETHER` or more are at their upper ends both. A distribution without limits ends at three
    standard deviations. Raises SystemInvalid instead of warnings unless the system allows them
    (see `System.with_mismatches`).
    """
    drawn = [
        (q.label, t.name, t.between(t.distribution.range))
        for q in quantities
        for t in q.targets
        if t.name.rpartition(".")[2] in WEIGHT
    ]
    ends = []
    for heavier in (1, -1):
        sides: dict[str, int] = {}  # 1: the upper end, by label
        values = {}
        for label, name, limits in drawn:
            if label not in sides:
                pairs = ((sides[b], _of_pair(correlation, label, b)) for b in sides)
                joint = [
                    side if rho > 0.0 else -side for side, rho in pairs if abs(rho) >= TOGETHER
                ]
                own = heavier * WEIGHT[name.rpartition(".")[2]] or 1
                sides[label] = joint[0] if joint else own
            values[name] = limits[sides[label] > 0]
        ends.append(values)
    return _refused(places, ends if drawn else [])


def _of_pair(correlation: Mapping[tuple[str, str], float], a: str, b: str) -> float:
    return correlation.get((a, b), correlation.get((b, a), 0.0))


def net_weight_of_runs(places: Places, start: Mapping[str, Array], n: int) -> tuple[str, ...]:
    """Return the same warnings of the heaviest and the lightest of n runs, of each hull."""
    ends = []
    for path in dict.fromkeys(name.rpartition(".")[0] for name in start):
        drawn = {
            v: np.asarray(start[f"{path}.{v}"], dtype=float).reshape(n)
            for v in WEIGHT
            if f"{path}.{v}" in start and places.variables[f"{path}.{v}"].size == 1
        }
        given = {
            v: float(places.start(f"{path}.{v}")) for v in WEIGHT if _is_scalar(places, path, v)
        }
        weights = net_weight({**given, **drawn}) if drawn else None
        if weights is not None:
            net = weights[0] - weights[1]
            rows = {int(np.argmax(net)), int(np.argmin(net))}
            ends += [{f"{path}.{v}": float(x[row]) for v, x in drawn.items()} for row in rows]
    return _refused(places, ends)


def _is_scalar(places: Places, path: str, name: str) -> bool:
    v = places.variables.get(f"{path}.{name}")
    return v is not None and v.size == 1


def _refused(places: Places, ends: Sequence[Mapping[str, float]]) -> tuple[str, ...]:
    found = list(dict.fromkeys(p for values in ends for p in _problems(places, values)))
    if found and places.system.mismatches == "refuse":
        raise SystemInvalid(or_forced(found))
    return tuple(map(str, found))


def _problems(places: Places, values: Mapping[str, float]) -> Iterator[Problem]:
    for p in net_weight_findings(with_values(places.plan.components, values))[0]:
        own = [f"{k.rpartition('.')[2]} = {v:.4g}" for k, v in values.items()
               if k.rpartition(".")[0] == p.place]  # fmt: skip
        if own:  # another hull sinks without a draw: the system's own check is about it
            yield replace(p, place=f"{p.place} with {', '.join(own)}, which is drawn")
