"""Fitted numbers of thrusters as a set in thrusters.yaml (see thruster_geometry.py)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.actuators.thruster_geometry import OF_VEHICLE, options_of, thrusters_file
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.importing.vehicle_draft import quoted
from uuvsim_cosim.studies.identification.identify import Actuator, Identified, Number
from uuvsim_cosim.studies.identification.vehicle_text import inserted, is_known, replaced, words_of

if TYPE_CHECKING:
    from ruamel.yaml.comments import CommentedMap

__all__ = ["ThrusterSet", "thruster_set"]


@dataclass(frozen=True)
class ThrusterSet:
    """The set's component, and its text."""

    model: str
    text: str
    count: int  # of the vehicle's thrusters

    def names_in(self, folder: Path) -> set[str]:
        """Return the names of the sets that the folder's thrusters have."""
        return set(self._read(folder).get("sets", {}))

    def written(self, folder: Path) -> Path:
        """Write it into the folder's thrusters.yaml, and give that file."""
        file = folder / "thrusters.yaml"
        data = self._read(folder)
        text = inserted(file.read_text(encoding="utf-8"), data, self.text)
        replaced(file, text, lambda path: thrusters_file(Path(path)))
        return file

    def _read(self, folder: Path) -> CommentedMap:
        file = folder / "thrusters.yaml"
        if not file.is_file():
            raise InputInvalid(
                f"--save-as: {folder} has no thrusters.yaml",
                "a vehicle with thrusters, as numbers of thrusters were fitted",
            )
        data: CommentedMap = thrusters_file(file)
        if len(data["thrusters"]) != self.count:
            raise InputInvalid(
                file,
                f"{len(data['thrusters'])} thrusters, and the system's wrench has {self.count}",
                "the wrench of that vehicle",
            )
        return data


def thruster_set(found: Identified, name: str, day: str) -> ThrusterSet | None:
    """Return the set of the fitted parameters of thrusters; None if none of them is known.

    A parameter that all thrusters share is one number. Else there is one for each thruster; those
    that were not fitted keep the system's values.
    """
    if not found.actuators:
        return None
    sources = {a.source.partition("?")[0].removeprefix("model:") for a in found.actuators}
    model = next(iter(sources))
    if len(sources) > 1 or model not in OF_VEHICLE:
        raise InputInvalid(
            f"--save-as: numbers of {', '.join(sorted(sources))} were fitted",
            f"those of one component among {', '.join(OF_VEHICLE)}",
        )
    query = found.actuators[0].source.partition("?")[2]
    options = options_of(model, dict(parse_qsl(query)))
    rows = []
    for key, unit in _fitted(found.actuators, found.numbers):
        rows.append(_row(found, key, unit, day))
    rows = [r for r in rows if r]
    if not rows:
        return None
    plain = declare(model, **options).variables
    for key, value in found.actuators[0].held.items():
        shared = all(a.held.get(key) == value for a in found.actuators)
        if shared and value != float(np.ravel(plain[key].start)[0]):
            rows.append(
                f"      {key}: {{value: {value:.9g}, unit: {quoted(plain[key].unit)}, "
                'source: "set for the fit, not identified"}\n'
            )
    residuals = ", ".join(f"{n} {s:.2g}" for n, s in found.residuals.items())
    source = (
        f"identified from {found.recording} on {day} by uuvsim identify: {found.samples} samples "
        f"of {found.seconds:.4g} s; residuals (rms): {residuals}"
    )
    chosen = "".join(f"{k}: {quoted(v)}, " for k, v in options.items()).removesuffix(", ")
    text = (
        f"  {name}:\n    model: {model}\n"
        + (f"    options: {{{chosen}}}\n" if chosen else "")
        + f"    source: {quoted(source)}\n    parameters:\n"
        + "".join(rows)
    )
    return ThrusterSet(model, text, found.actuators[0].of)


def _fitted(actuators: Sequence[Actuator], numbers: Sequence[Number]) -> list[tuple[str, str]]:
    """Return (parameter, unit) of each number that is a thruster's, once."""
    paths = {a.path for a in actuators}
    out: dict[str, str] = {}
    for n in numbers:
        for place in n.places:
            path, _, key = place.rpartition(".")
            if path in paths:
                out.setdefault(key, n.unit)
    return list(out.items())


def _row(found: Identified, key: str, unit: str, day: str) -> str:
    """Return the line of a parameter: one number, or one for each thruster."""
    of: dict[int, Number] = {}
    for a in found.actuators:
        number = next((n for n in found.numbers if f"{a.path}.{key}" in n.places), None)
        if number is not None and is_known(number):
            of[a.number] = number
    count = found.actuators[0].of
    if not of:
        return ""
    shared = set(of) == set(range(1, count + 1)) and len({n.name for n in of.values()}) == 1
    if shared:
        n = of[1]
        value, interval = f"{n.value:.9g}", f"{n.low:.6g}, {n.high:.6g}"
        words = words_of(found, n, day)
    else:
        some = of[min(of)]
        values = [of[k].value if k in of else some.start for k in range(1, count + 1)]
        ends = [(of[k].low, of[k].high) if k in of else (some.start,) * 2
                for k in range(1, count + 1)]  # fmt: skip
        value = f"[{', '.join(f'{v:.9g}' for v in values)}]"
        interval = ", ".join(f"[{low:.6g}, {high:.6g}]" for low, high in ends)
        missing = [str(k) for k in range(1, count + 1) if k not in of]
        words = f"identified from {found.recording} on {day}, 95 % intervals beside it"
        if missing:
            words += f"; not identified of thruster {', '.join(missing)}: as before"
    return (
        f"      {key}: {{value: {value}, unit: {quoted(unit)}, interval: [{interval}], "
        f"source: {quoted(words)}}}\n"
    )
